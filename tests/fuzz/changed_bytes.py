"""Files changed as damage, faulty exporters and mischief change them; all chance comes from `rng`."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

Change = Callable[[bytes, np.random.Generator], bytes]

INTEGERS = (0, 1, 2, 3, 7, 127, 128, 255, 256, 32767, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**62,
            2**63 - 1, 2**63, 2**64 - 1)  # fmt: skip
"""Counts at which formats and programs change their minds."""
WORDS = (
    b"nan", b"-nan", b"inf", b"-inf", b"1e400", b"-1e308", b"1e-320", b"0", b"-0", b"-1", b"1", b"3",
    b"99999999999", b"18446744073709551616", b"-2147483649", b"1_000", b"0x10", b"1,5", b"", b"x", b"1e",
    b"--", b"+", b".", b"9" * 5000, b"4294967295", b"1000000", b"0.1.2", b'"', b"'1", b"None",
    b"1d5", "١٢".encode(), b"\xff\xfe", b"\0"
)  # fmt: skip
"""What may stand where a number should."""
TYPES = (
    (b"float", b"double", b"int", b"uchar", b"char", b"short", b"ushort", b"uint", b"list uchar int", b"list int float",
     b"list double float", b"int64", b"float32", b"list uint uchar", b"string", b"vtktypeint64", b"unsigned_char"),
    (b"ascii", b"binary_little_endian", b"binary_big_endian", b"binary", b"binary_compressed", b"BINARY", b"ASCII",
    b"appended"),
    (b" F", b" U", b" I", b" S", b" "),
    (b"<f4", b"<f8", b">f4", b"<i4", b"|u1", b"|O", b"<c16", b"<f2", b"<U9", b"|b1", b"<M8[s]", b"|V12", b">f8",
    b"<u8", b"|S3"),
    (b"Float32", b"Float64", b"Int32", b"UInt8", b"Int64", b"UInt64", b"String"),
    (b"x", b"y", b"z", b"X", b"nx", b"red", b"lat", b"vertex", b"points"),
    (b"OFF", b"STOFF", b"4OFF", b"COFF", b"NOFF", b"CNOFF", b"nOFF", b"STCN4OFF"),
    (b"POINTS", b"WIDTH", b"HEIGHT", b"COUNT", b"SIZE", b"TYPE", b"FIELDS", b"VIEWPOINT", b"VERSION", b"DATA"),
    (b"POLYDATA", b"UNSTRUCTURED_GRID", b"STRUCTURED_GRID", b"RECTILINEAR_GRID", b"STRUCTURED_POINTS", b"FIELD"),
    (b" ", b",", b";", b"\t", b"  ", b" ,", b"|", b":"),
    (b"\n", b"\r\n", b"\r", b"\n\n", b"\x0b", b"\x00"),
)  # fmt: skip
"""Words of which one may stand for another in a header."""
HEAD = 512
"""Bytes in which most formats keep what matters most."""


def changed(blob: bytes, rng: np.random.Generator, others: Sequence[bytes] = ()) -> bytes:
    """The bytes with a few changes; `others` are files to graft parts of."""
    for _ in range(int(rng.choice([1, 1, 1, 2, 3, 6]))):
        if others and rng.random() < 0.1:
            blob = grafted(blob, others[rng.integers(len(others))], rng)
        else:
            blob = CHANGES[rng.integers(len(CHANGES))](blob, rng)
    return blob


def grafted(blob: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """The bytes with a piece of others in them, or the others' end behind their beginning."""
    piece = _piece(other, rng)
    at = _place(blob, rng)
    return (
        blob[:at] + other[_place(other, rng) :] if rng.random() < 0.5 else blob[:at] + piece + blob[at + len(piece) :]
    )


def _flipped(blob: bytes, rng: np.random.Generator) -> bytes:
    changing = bytearray(blob)
    for _ in range(int(rng.integers(1, 9)) if blob else 0):
        changing[_place(blob, rng) % len(blob)] ^= 1 << int(rng.integers(8))
    return bytes(changing)


def _set(blob: bytes, rng: np.random.Generator) -> bytes:
    at, length = _place(blob, rng), int(rng.choice([1, 2, 4, 8, 16]))
    return (
        blob[:at] + bytes([int(rng.choice([0, 1, 127, 128, 255]))]) * min(length, len(blob) - at) + blob[at + length :]
    )


def _counted(blob: bytes, rng: np.random.Generator) -> bytes:
    """A number as machines write it in place of some bytes."""
    size = int(rng.choice([1, 2, 4, 8]))
    number = int(INTEGERS[rng.integers(len(INTEGERS))]) % 2 ** (8 * size)
    at = _place(blob, rng) // size * size if rng.random() < 0.5 else _place(blob, rng)
    written = number.to_bytes(size, "little" if rng.random() < 0.8 else "big")
    return blob[:at] + written[: max(0, len(blob) - at)] + blob[at + size :]


def _nudged(blob: bytes, rng: np.random.Generator) -> bytes:
    """A machine's whole number that is there, a little larger or smaller, or twice as large."""
    size, at = int(rng.choice([1, 2, 4, 8])), _place(blob, rng)
    number = int.from_bytes(blob[at : at + size], "little")
    number = (number + int(rng.choice([-2, -1, 1, 2, number]))) % 2 ** (8 * size)
    return blob[:at] + number.to_bytes(size, "little")[: max(0, len(blob) - at)] + blob[at + size :]


def _real(blob: bytes, rng: np.random.Generator) -> bytes:
    """A float that is no coordinate in place of some bytes."""
    kind = rng.choice(["<f4", "<f8", ">f4", ">f8"])
    with np.errstate(over="ignore"):
        written = (
            np.array(rng.choice([np.nan, np.inf, -np.inf, 1e308, -1e38, 1e-320, 3.4e38, 1e20])).astype(kind).tobytes()
        )
    at = _place(blob, rng) // len(written) * len(written)
    return blob[:at] + written[: max(0, len(blob) - at)] + blob[at + len(written) :]


def _cut(blob: bytes, rng: np.random.Generator) -> bytes:
    return blob[: _place(blob, rng)]


def _longer(blob: bytes, rng: np.random.Generator) -> bytes:
    more = int(rng.choice([1, 3, 16, 100, 5000]))
    return blob + [bytes(more), rng.bytes(more), blob[-more:], b"\n" * more, b" " * more][rng.integers(5)]


def _piece_gone(blob: bytes, rng: np.random.Generator) -> bytes:
    at = _place(blob, rng)
    return blob[:at] + blob[at + int(rng.choice([1, 2, 4, 12, 100])) :]


def _piece_twice(blob: bytes, rng: np.random.Generator) -> bytes:
    piece, at = _piece(blob, rng), _place(blob, rng)
    return blob[:at] + piece * int(rng.choice([1, 2, 50])) + blob[at:]


def _number(blob: bytes, rng: np.random.Generator) -> bytes:
    """Another word for a written number, in the head more often than elsewhere."""
    end = HEAD if rng.random() < 0.6 else len(blob)
    found = list(re.finditer(rb"[+-]?\d[\d.eE+-]*", blob[:end]))
    if not found:
        return _counted(blob, rng)
    match = found[rng.integers(len(found))]
    word = WORDS[rng.integers(len(WORDS))] if rng.random() < 0.7 else b"%d" % INTEGERS[rng.integers(len(INTEGERS))]
    return blob[: match.start()] + word + blob[match.end() :]


def _other_word(blob: bytes, rng: np.random.Generator) -> bytes:
    """One word of a kind for another, once or everywhere."""
    for index in rng.permutation(len(TYPES)):
        there = [word for word in TYPES[index] if word in blob]
        if there:
            old = there[rng.integers(len(there))]
            new = TYPES[index][rng.integers(len(TYPES[index]))]
            return blob.replace(old, new, 1 if rng.random() < 0.7 else -1)
    return _set(blob, rng)


def _lines(blob: bytes, rng: np.random.Generator) -> bytes:
    """Lines dropped, repeated, exchanged, emptied, joined, shortened or put in."""
    lines = blob.split(b"\n")
    at = int(rng.integers(min(len(lines), 30) if rng.random() < 0.6 else len(lines)))
    other = int(rng.integers(len(lines)))
    match int(rng.integers(8)):
        case 0:
            del lines[at]
        case 1:
            lines[at:at] = [lines[at]] * int(rng.choice([1, 2, 100]))
        case 2:
            lines[at], lines[other] = lines[other], lines[at]
        case 3:
            lines[at] = b""
        case 4:
            lines[at : at + 2] = [b" ".join(lines[at : at + 2])]
        case 5:
            lines[at] = lines[at].rpartition(b" ")[0]
        case 6:
            lines.insert(
                at, [b"# note", b"hello, world", b"0 0 0", b"//X Y Z", b"3", b'"', b"\xef\xbb\xbf"][rng.integers(7)]
            )
        case _:
            lines[at] = lines[at] + b" " + lines[other][:40]
    return b"\n".join(lines)


def _blanks(blob: bytes, rng: np.random.Generator) -> bytes:
    """Another encoding, or another way to end lines."""
    match int(rng.integers(5)):
        case 0:
            return b"\xef\xbb\xbf" + blob
        case 1:
            return blob.decode("latin-1").encode("utf-16")
        case 2:
            return blob.replace(b"\n", b"\r\n")
        case 3:
            return blob.replace(b"\n", b"\r")
        case _:
            return blob.replace(b"\n", b" ", int(rng.integers(1, 20)))


def _place(blob: bytes, rng: np.random.Generator) -> int:
    """An index into the bytes, in half of the cases near their beginning."""
    end = min(len(blob), HEAD) if rng.random() < 0.5 else len(blob)
    return int(rng.integers(end + 1))


def _piece(blob: bytes, rng: np.random.Generator) -> bytes:
    at = _place(blob, rng)
    return blob[at : at + int(rng.choice([1, 4, 12, 50, 400]))]


CHANGES: tuple[Change, ...] = (_flipped, _set, _counted, _nudged, _real, _cut, _longer, _piece_gone, _piece_twice,
    _number,
                               _number, _number, _other_word, _other_word, _lines, _lines, _blanks)  # fmt: skip
