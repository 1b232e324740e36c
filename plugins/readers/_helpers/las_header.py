"""Checks the counts in a LAS header against the size of the file, before a library relies on them."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, BinaryIO

from z2p_core.interfaces import ScanError

_LAZ_RECORD_ID, _CHUNK_SIZE_AT = 22204, 12
"""Number of the record that says how points are packed, and where in it the size of a chunk stands."""
_MAX_CHUNK_POINTS = 1_000_000
"""Larger chunks are cut where a block of points ends."""


def promised_points(path: Path) -> int:
    """The number of points in the header; 0 if it is no LAS header, or the file is far too short for them."""
    with path.open("rb") as file:
        head = file.read(375).ljust(375, b"\0")
    (legacy,), (count,) = struct.unpack_from("<I", head, 107), struct.unpack_from("<Q", head, 247)
    if head[:4] != b"LASF" or path.stat().st_size < (legacy or count) // 100:
        return 0  # another format, or a lie: read says so
    return int(count if head[24:26] >= b"\x01\x04" and count else legacy)


def packed_chunk_points(header: Any) -> int:
    """Points of each chunk of a compressed file, by laspy's header; 1 where they are not packed, or chunks differ."""
    for record in header.vlrs:
        data = getattr(record, "record_data", b"") if getattr(record, "record_id", None) == _LAZ_RECORD_ID else b""
        if len(data) >= _CHUNK_SIZE_AT + 4:
            (points,) = struct.unpack_from("<I", data, _CHUNK_SIZE_AT)
            return int(points) if 0 < points <= _MAX_CHUNK_POINTS else 1
    return 1


def check_records(path: Path) -> None:
    """Raises ScanError unless the file has room for the records and the chunk table that its header promises.

    laspy would look for the records for ever, and lazrs would end the whole process on a table too large for memory.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(375).ljust(375, b"\0")
        chunks = _chunk_count(file, size, *struct.unpack_from("<I", head, 96)) if head[104] & 0xC0 else 0
    if head[:4] != b"LASF":
        raise ScanError("expected a LAS file, which begins with 'LASF'; this is another format under that name")
    header_size, points_at, records = struct.unpack_from("<HII", head, 94)
    fits = header_size + 54 * records <= points_at <= size and chunks <= size
    if head[24:26] >= b"\x01\x04":  # LAS 1.4 may have more of them behind the points
        extended_at, extended = struct.unpack_from("<QI", head, 235)
        fits = fits and (extended == 0 or extended_at + 60 * extended <= size)
    if not fits:
        raise ScanError(f"the LAS header promises more than its {size} bytes hold; the file is cut short or its header "
                        "is wrong: export it again")


def _chunk_count(file: BinaryIO, size: int, points_at: int) -> int:
    """The number of chunks in the table of a compressed file; 0 if the table's position is not in the file."""
    file.seek(points_at)
    (table_at,) = struct.unpack("<q", file.read(8).ljust(8, b"\0"))
    if table_at == -1 and size >= 8:  # written as a stream: the place of the table stands at the very end
        file.seek(size - 8)
        (table_at,) = struct.unpack("<q", file.read(8))
    if not 0 < table_at <= size - 8:
        return 0
    file.seek(table_at)
    return struct.unpack("<II", file.read(8))[1]
