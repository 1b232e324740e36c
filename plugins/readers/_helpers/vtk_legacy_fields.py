"""Values of the points in VTK's legacy files: the sections behind POINT_DATA, in text or binary."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from urllib.parse import unquote

import numpy as np

from z2p_core.interfaces import ScanError

NUMPY_TYPES = {
    "float": "f4", "double": "f8", "char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2",
    "int": "i4", "unsigned_int": "u4", "long": "i8", "unsigned_long": "u8", "vtktypeint64": "i8", "vtktypeint32": "i4",
    "vtkidtype": "i4", "signed_char": "i1", "vtktypeuint64": "u8", "vtktypeuint32": "u4", "vtktypeuint8": "u1",
}  # fmt: skip
"""VTK's names of types -> numpy's."""
_POINT_DATA = re.compile(rb"^[ \t]*POINT_DATA[ \t]+(\d{1,15})[ \t]*\r?\n", re.MULTILINE | re.IGNORECASE)
_WIDTHS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6}
_WORDS_AT_ONCE = 100_000


@dataclass(frozen=True)
class LegacyArray:
    """An array of `count` x `width` numbers that begins at byte `start` of the file."""

    name: str
    width: int
    type: np.dtype
    start: int
    is_color: bool = False
    """Whether the file says that it holds colors."""


def find_arrays(blob: bytes, start: int, count: int, binary: bool) -> list[LegacyArray]:
    """The arrays of the points, behind byte `start` of the file, up to the first that is not understood."""
    section = _POINT_DATA.search(blob, start)
    if section is None or int(section[1]) != count:
        return []
    arrays: list[LegacyArray] = []
    try:
        for array in _iter_arrays(blob, section.end(), count, binary):
            arrays.append(array)
    except (ValueError, KeyError, IndexError):
        return arrays
    return arrays


def read_array(blob: bytes, array: LegacyArray, count: int, binary: bool) -> np.ndarray:
    """The numbers (count,) or (count, width) of an array.

    Raises:
        ScanError: the file ends before them, or they are no numbers.
    """
    total = count * array.width
    try:
        if binary:
            values = np.frombuffer(blob, array.type, total, array.start)
        else:
            values = np.array(blob[array.start :].split(None, total)[:total], dtype=np.float64)
            if array.type.kind in "iu" and not array.is_color:
                values = values.astype(array.type.newbyteorder("="))
    except ValueError as error:
        raise ScanError(f"the VTK values {array.name[:40]!r} cannot be read ({str(error)[:80]}); export the file "
                        "again") from error
    if len(values) != total:
        raise ScanError(f"the VTK file ends in its values {array.name[:40]!r}; it is cut short: export it again")
    return values if array.width == 1 else values.reshape(count, array.width)


def _iter_arrays(blob: bytes, at: int, count: int, binary: bool) -> Iterator[LegacyArray]:
    """The arrays of the points in turn.

    Raises:
        ValueError, KeyError, IndexError: the next one is not understood.
    """
    while True:
        words, at = _next_line(blob, at)
        match [words[0].upper(), *words[1:]] if words else []:
            case ["SCALARS", name, kind, *rest]:
                words, behind = _next_line(blob, at)
                at = behind if words and words[0].upper() == "LOOKUP_TABLE" else at
                array = LegacyArray(unquote(name), int(rest[0]) if rest else 1, _type(kind), at)
            case ["COLOR_SCALARS", name, width]:
                array = LegacyArray(unquote(name), int(width), np.dtype("u1" if binary else "f4"), at, is_color=True)
            case [("VECTORS" | "NORMALS" | "TENSORS" | "TENSORS6") as section, name, kind]:
                array = LegacyArray("normals" if section == "NORMALS" else unquote(name), _WIDTHS[section],
                                    _type(kind), at)  # fmt: skip
            case ["TEXTURE_COORDINATES", name, width, kind]:
                array = LegacyArray(unquote(name), int(width), _type(kind), at)
            case ["LOOKUP_TABLE", _, size]:
                at = _end_of(blob, LegacyArray("", 4, np.dtype("u1"), at), int(size), binary)
                continue
            case ["FIELD", _, number]:
                for _ in range(int(number)):
                    array, rows, at = _next_field(blob, at, binary)
                    if rows == count:
                        yield array
                continue
            case ["METADATA"]:
                at = _skip_metadata(blob, at)
                continue
            case _:
                return
        yield array
        at = _end_of(blob, array, count, binary)


def _next_field(blob: bytes, at: int, binary: bool) -> tuple[LegacyArray, int, int]:
    """The next array of a FIELD section, its number of rows, and the offset behind it."""
    words, at = _next_line(blob, at)
    while words and words[0].upper() == "METADATA":
        words, at = _next_line(blob, _skip_metadata(blob, at))
    name, width, rows, kind = words
    array = LegacyArray(unquote(name), int(width), _type(kind), at)
    return array, int(rows), _end_of(blob, array, int(rows), binary)


def _type(kind: str) -> np.dtype:
    return np.dtype(">" + NUMPY_TYPES[kind.lower()])


def _next_line(blob: bytes, at: int) -> tuple[list[str], int]:
    """The words of the next line that is not empty, and the offset behind it; no words at the end of the file."""
    while at < len(blob):
        end = blob.find(b"\n", at)
        end = len(blob) if end < 0 else end
        words = blob[at:end].decode("utf-8", errors="replace").split()
        at = end + 1
        if words:
            return words, at
    return [], at


def _skip_metadata(blob: bytes, at: int) -> int:
    """The offset behind the empty line that ends a METADATA block."""
    end = re.compile(rb"\r?\n[ \t]*\r?\n").search(blob, max(at - 1, 0))
    return len(blob) if end is None else end.end()


def _end_of(blob: bytes, array: LegacyArray, count: int, binary: bool) -> int:
    """The offset behind an array of `count` rows.

    Raises:
        ValueError: the file ends before.
    """
    total = count * array.width
    if binary:
        end = array.start + total * array.type.itemsize
        if end > len(blob):
            raise ValueError(array.name)
        return end
    at = array.start
    while total > 0:
        some = min(total, _WORDS_AT_ONCE)
        window = blob[at : at + 32 * some + 64]
        parts = window.split(None, some)
        if len(parts) < some or (len(parts) == some and at + len(window) < len(blob)):
            raise ValueError(array.name)
        rest = len(parts[some]) if len(parts) > some else 0
        at += len(window) - rest
        total -= some
    return at
