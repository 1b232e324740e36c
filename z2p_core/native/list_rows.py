"""The kernel that walks rows of a binary file in which lists stand."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from z2p_core.native.library import BYTES, DOUBLES_OUT, INT64S, INT64S_OUT, INTS, call, declare

declare(
    "z2p_rows", file=BYTES, bounds=INT64S, kinds=INTS, lengths=INTS, places=INTS, values=DOUBLES_OUT, end=INT64S_OUT,
)  # fmt: skip

_KINDS = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")


def walk_rows(
    file: bytes, start: int, count: int, properties: Sequence[tuple[np.dtype, np.dtype | None]], wanted: Sequence[int]
) -> tuple[np.ndarray, int]:
    """Numbers (count, len(wanted)) float64 of `count` rows that begin at byte `start`, and where the rows end.

    A property is a number of its type, or, with a type for how many they are, a list of them; `wanted` are the indices
    of those whose numbers are given, which are no lists. All are of one byte order.

    Raises:
        ValueError: a row reaches past the end of the file.
    """
    kinds = [_KINDS.index(kind.str[1:]) for kind, _ in properties]
    lengths = [-1 if length is None else _KINDS.index(length.str[1:]) for _, length in properties]
    places = [wanted.index(index) if index in wanted else -1 for index in range(len(properties))]
    foreign = ">" if sys.byteorder == "little" else "<"
    swapped = any(kind.str[0] == foreign for pair in properties for kind in pair if kind is not None)
    least = sum((length or kind).itemsize for kind, length in properties)
    if count * least > len(file) - start:  # before memory is taken for what cannot be there
        raise ValueError(f"{count} rows of {least} bytes at least begin at byte {start} of {len(file)}")
    values, end = np.zeros((count if wanted else 0, len(wanted))), np.zeros(1, np.int64)
    bounds = np.array([len(file), start, count, len(properties), swapped, len(wanted)], np.int64)
    tables = (np.array(table or [0], np.int32) for table in (kinds, lengths, places))
    call("z2p_rows", np.frombuffer(file or b"\0", np.uint8), bounds, *tables, values, end)
    if end[0] < 0:
        raise ValueError(f"a row that begins behind byte {start} reaches past the end of the file's {len(file)} bytes")
    return values, int(end[0])
