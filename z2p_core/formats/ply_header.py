"""Parses PLY headers, and checks their counts against the size of a file; no file is opened here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from z2p_core.interfaces import ScanError

LONGEST_HEADER = 1 << 16
"""Bytes of the file that are searched for the end of the header."""

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8",
    "uint64": "u8",
}  # fmt: skip
_ENCODINGS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class PlyProperty:
    """One value of an element, or, with a `length` type, a list of values."""

    name: str
    type: np.dtype
    length: np.dtype | None


@dataclass(frozen=True)
class PlyElement:
    """`count` rows of the same properties."""

    name: str
    count: int
    properties: tuple[PlyProperty, ...]

    @property
    def scalar(self) -> bool:
        """Whether all rows have the same size, because no property is a list."""
        return all(entry.length is None for entry in self.properties)

    @property
    def dtype(self) -> np.dtype:
        """Packed row of a scalar element, as a binary file holds it."""
        return np.dtype([(entry.name, entry.type) for entry in self.properties])

    def least_bytes(self, ascii: bool) -> int:
        """Least size of its rows in bytes: every list is empty, every ascii number is one digit and a blank."""
        each = [2 if ascii else (entry.length or entry.type).itemsize for entry in self.properties]
        return self.count * sum(each)


@dataclass(frozen=True)
class PlyHeader:
    """A parsed header: `encoding` as written in the file, elements in file order, `size` in bytes."""

    encoding: str
    elements: tuple[PlyElement, ...]
    size: int

    @property
    def ascii(self) -> bool:
        """Whether the rows are text lines."""
        return self.encoding == "ascii"

    def element(self, name: str) -> PlyElement | None:
        """The element of that name, or None."""
        return next((element for element in self.elements if element.name == name), None)

    def check_size(self, file_size: int) -> None:
        """Checks that a file of `file_size` bytes can hold the elements of the header.

        Raises:
            ScanError: it is too small, or it is binary with rows of fixed size and has another size.
        """
        body = file_size - self.size
        least = sum(element.least_bytes(self.ascii) for element in self.elements)
        if self.ascii:
            least -= 1  # the last line may lack its newline
        promised = ", ".join(f"{element.count} {element.name}" for element in self.elements)
        exact = not self.ascii and all(element.scalar for element in self.elements)
        if body < least or (exact and body != least):
            raise ScanError(
                f"the PLY header promises {promised}, which takes {'' if exact else 'at least '}{max(least, 0)} bytes, "
                f"but {body} follow it; the file is cut short or its header is wrong: export it again"
            )


def parse_header(head: bytes) -> PlyHeader:
    """The header at the beginning of a PLY file, from its first `LONGEST_HEADER` bytes.

    Raises:
        ScanError: this is no PLY header; the message says which line is wrong.
    """
    if head[:3] != b"ply" or head[3:4] not in (b"\n", b"\r", b" "):
        raise ScanError("expected a PLY file, which begins with the line 'ply'; this is another format under that name")
    marker = head.find(b"\nend_header")
    end = head.find(b"\n", marker + 1)
    if marker < 0 or end < 0:
        raise ScanError("the PLY header has no line 'end_header'; export the file again")
    lines = [line.split() for line in head[:end].decode("utf-8", errors="replace").splitlines()[1:-1]]
    encoding = ""
    elements: list[tuple[str, int, list[PlyProperty]]] = []
    for words in lines:
        try:
            match words:
                case ["format", encoding, *_]:
                    _ENCODINGS[encoding]
                case ["element", name, count]:
                    elements.append((name, _count(count), []))
                case ["property", *_]:
                    elements[-1][2].append(_property(words, _ENCODINGS[encoding]))
        except (KeyError, ValueError, IndexError) as error:
            raise ScanError(f"the PLY header's line {' '.join(words)[:80]!r} is not understood; "
                            f"export the file again") from error
    if not encoding:
        raise ScanError("the PLY header has no line 'format'; export the file again")
    return PlyHeader(encoding, tuple(PlyElement(name, count, tuple(rows)) for name, count, rows in elements), end + 1)


def _count(word: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 19):
        raise ValueError(word)
    return int(word)


def _property(words: list[str], order: str) -> PlyProperty:
    """The property that a header line declares."""
    match words:
        case ["property", "list", length, kind, name] if _TYPES[length][0] != "f":
            return PlyProperty(name, np.dtype(order + _TYPES[kind]), np.dtype(order + _TYPES[length]))
        case ["property", kind, name]:
            return PlyProperty(name, np.dtype(order + _TYPES[kind]), None)
    raise ValueError(words)
