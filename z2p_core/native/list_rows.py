"""Reads binary rows whose properties are numbers or lists, as in PLY files."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from z2p_core.native.library import BYTES, DOUBLES_OUT, INT64S, INT64S_OUT, INTS, call, declare

declare(
    "z2p_read_list_rows", file=BYTES, bounds=INT64S, types=INTS, length_types=INTS, columns=INTS, values=DOUBLES_OUT,
    end_offset=INT64S_OUT,
)  # fmt: skip

_TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")
"""In the order of the C file's enum."""


def read_list_rows(
    file: bytes, start: int, count: int, properties: Sequence[tuple[np.dtype, np.dtype | None]], wanted: Sequence[int]
) -> tuple[np.ndarray, int]:
    """Numbers (count, len(wanted)) float64 of `count` rows that begin at byte `start`, and the offset where they end.

    Args:
        file: all bytes of the file.
        start: offset of the first row.
        count: number of rows.
        properties: of a row: (type, None) for a number, (type, type of the length) for a list; all of one byte order.
        wanted: indices of the properties to return, none of which is a list.

    Raises:
        ValueError: a row reaches past the end of the file.
    """
    types = [_TYPES.index(kind.str[1:]) for kind, _ in properties]
    length_types = [-1 if length is None else _TYPES.index(length.str[1:]) for _, length in properties]
    columns = [wanted.index(index) if index in wanted else -1 for index in range(len(properties))]
    foreign = ">" if sys.byteorder == "little" else "<"
    is_swapped = any(kind.str[0] == foreign for pair in properties for kind in pair if kind is not None)
    min_row_bytes = sum((length or kind).itemsize for kind, length in properties)
    if count * min_row_bytes > len(file) - start:  # checked before memory is allocated for rows that cannot be there
        raise ValueError(f"{count} rows of {min_row_bytes} bytes at least begin at byte {start} of {len(file)}")
    values, end_offset = np.zeros((count if wanted else 0, len(wanted))), np.zeros(1, np.int64)
    bounds = np.array([len(file), start, count, len(properties), is_swapped, len(wanted)], np.int64)
    tables = (np.array(table or [0], np.int32) for table in (types, length_types, columns))
    call("z2p_read_list_rows", np.frombuffer(file or b"\0", np.uint8), bounds, *tables, values, end_offset)
    if end_offset[0] < 0:
        raise ValueError(f"a row that begins behind byte {start} reaches past the end of the file's {len(file)} bytes")
    return values, int(end_offset[0])
