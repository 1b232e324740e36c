"""Points of LAS and LAZ files, in real-world coordinates."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np

from z2p_core.interfaces import MEMORY_A_POINT, Reader, ScanError
from z2p_renderer.plugins.readers.late import late

_CHUNK = 1_000_000
"""Points unpacked at a time: a header that lies about its count costs one chunk, not the machine's memory."""


class Las(Reader):
    """Airborne and terrestrial laser scans (laspy, lazrs)."""

    name = "las"
    version = "1"
    packages = ("laspy", "lazrs")
    suffixes = (".las", ".laz")

    def memory(self, path: Path) -> int:
        """As many points as the header promises, which may be packed far tighter than in other formats."""
        with path.open("rb") as file:
            head = file.read(375).ljust(375, b"\0")
        (legacy,), (count,) = struct.unpack_from("<I", head, 107), struct.unpack_from("<Q", head, 247)
        if head[:4] != b"LASF" or path.stat().st_size < (legacy or count) // 100:
            return 0  # another format, or a lie: read says so
        return (count if head[24:26] >= b"\x01\x04" and count else legacy) * MEMORY_A_POINT

    def read(self, path: Path) -> list[np.ndarray]:
        """The file's points, one cloud (N, 3) float64, scale and offset applied in float64 (UTM keeps its digits).

        Raises:
            ScanError: no LAS file, or fewer points than its header promises.
        """
        if path.stat().st_size == 0:
            return [np.empty((0, 3))]
        _check_records(path)
        try:
            return [_read(path)]
        except (ScanError, ImportError):
            raise
        except Exception as error:  # laspy and lazrs raise whatever their parsing stumbles over
            raise _unreadable(error) from error
        except BaseException as error:
            if type(error).__name__ != "PanicException":  # lazrs' way to fail on a damaged file, no Exception
                raise
            raise _unreadable(error) from error


def _check_records(path: Path) -> None:
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
    """How many chunks a compressed file's table promises; 0 when the table is where only lazrs can tell."""
    file.seek(points_at)
    (table_at,) = struct.unpack("<q", file.read(8).ljust(8, b"\0"))
    if table_at == -1 and size >= 8:  # written as a stream: the place of the table stands at the very end
        file.seek(size - 8)
        (table_at,) = struct.unpack("<q", file.read(8))
    if not 0 < table_at <= size - 8:
        return 0
    file.seek(table_at)
    return struct.unpack("<II", file.read(8))[1]


def _read(path: Path) -> np.ndarray:
    laspy = late("laspy")
    single = laspy.LazBackend.Lazrs  # the parallel one believes the chunk sizes of a damaged file, and aborts on them
    with laspy.open(path, laz_backend=single) as reader:
        header = reader.header
        count, row = header.point_count, header.point_format.size
        body = path.stat().st_size - header.offset_to_point_data
        if body < 0 or (not header.are_points_compressed and count * row > body):
            raise ScanError(f"the LAS header promises {count} points of {row} bytes, {max(body, 0)} bytes follow it; "
                            "the file is cut short or its header is wrong: export it again")
        chunks = [np.column_stack([chunk.x, chunk.y, chunk.z]) for chunk in reader.chunk_iterator(_CHUNK)]
    points = np.concatenate([np.empty((0, 3)), *chunks])
    if len(points) != count:
        raise ScanError(f"the LAS header promises {count} points, {len(points)} came; export the file again")
    return points


def _unreadable(error: BaseException) -> ScanError:
    return ScanError(f"the LAS file cannot be read ({' '.join(str(error).split())[:160]}); export it again")
