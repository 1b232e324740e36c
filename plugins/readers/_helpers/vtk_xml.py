"""Points of VTK's XML files, whose arrays are text, base64 or appended bytes, compressed or not."""

from __future__ import annotations

import base64
import binascii
import lzma
import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.interfaces import RawCloud, ScanError
from z2p_renderer.plugins.readers._helpers.point_fields import Wants, only_bytes, plan_arrays

_NUMPY_TYPES = {"Float32": "f4", "Float64": "f8", "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2",
                "Int32": "i4", "UInt32": "u4", "Int64": "i8", "UInt64": "u8"}  # fmt: skip
_DATASET_TYPES = ("PolyData", "UnstructuredGrid")
_APPENDED_DATA = re.compile(rb"<AppendedData\b[^>]*>\s*_")


@dataclass(frozen=True)
class _File:
    """Encoding shared by all arrays of a file: byte order, type of length headers, decompressor, appended bytes."""

    order: str
    header: np.dtype
    unpack: Callable[[bytes, int], bytes] | None
    appended: bytes
    in_base64: bool
    """Whether the appended bytes are base64."""


def cloud_of_xml(blob: bytes, wants: Wants) -> RawCloud:
    """The points (N, 3) float64 of all pieces, with the wanted values that come with them.

    Raises:
        ScanError: no VTK file of points, a damaged one, or one packed in a way that is not read.
    """
    try:
        tree, file = _parse_xml(blob)
        pieces = [piece for piece in tree.iter("Piece") if int(piece.get("NumberOfPoints", "0"))]
        parts = [_read_points(piece, file) for piece in pieces]
        values = [_value_arrays(piece) for piece in pieces]
        common = {name: _components(array) for name, array in values[0].items()
                  if all(name in others for others in values)} if values else {}  # fmt: skip
        color = only_bytes({name: (width, np.dtype(_NUMPY_TYPES[values[0][name].get("type", "")]))
                            for name, width in common.items()})  # fmt: skip
        fields = plan_arrays(common, wants, color)
        arrays = {name: np.concatenate([_read_values(piece, given[name], file)
                                        for piece, given in zip(pieces, values, strict=True)])
                  for name in fields.arrays}  # fmt: skip
    except ScanError:
        raise
    except (ElementTree.ParseError, ValueError, KeyError, binascii.Error, zlib.error, lzma.LZMAError) as error:
        message = f"the VTK file cannot be read ({error_reason(error)}); it is damaged: export it again"
        raise ScanError(message) from error
    return fields.fill(RawCloud(np.concatenate([np.empty((0, 3)), *parts])), arrays)


def _value_arrays(piece: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """The arrays of numbers that a piece has of its points, by name."""
    arrays = (array for array in piece.iterfind("PointData/DataArray") if array.get("type") in _NUMPY_TYPES)
    return {array.get("Name") or f"array {index}": array for index, array in enumerate(arrays, start=1)}


def _components(array: ElementTree.Element) -> int:
    return int(array.get("NumberOfComponents") or 1)


def _read_values(piece: ElementTree.Element, array: ElementTree.Element, file: _File) -> np.ndarray:
    """The values (N,) or (N, components) of the points of a piece."""
    count, width = int(piece.get("NumberOfPoints", "0")), _components(array)
    numbers = _read_numbers(array, count * width, file)
    if len(numbers) != count * width:
        name = str(array.get("Name"))[:40]
        raise ScanError(f"the VTK file promises {count} points, and {len(numbers)} numbers of {name!r} came; export it "
                        "again")
    return numbers if width == 1 else numbers.reshape(count, width)


def _parse_xml(blob: bytes) -> tuple[ElementTree.Element, _File]:
    """The XML tree of a file, and the encoding of its arrays."""
    split = _APPENDED_DATA.search(blob)
    text, appended = (blob, b"") if split is None else (blob[: split.start()] + b"</VTKFile>", blob[split.end() :])
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise ScanError("a VTK file has no document type of its own; export it again")
    tree = ElementTree.fromstring(text)
    if tree.tag != "VTKFile" or tree.get("type") not in _DATASET_TYPES:
        raise ScanError(f"expected a VTKFile of PolyData or UnstructuredGrid, got {tree.tag[:40]} of "
                        f"{tree.get('type', 'no type')[:40]}; save it as poly data (.vtp)")
    order = ">" if tree.get("byte_order") == "BigEndian" else "<"
    header = np.dtype(order + _NUMPY_TYPES[tree.get("header_type", "UInt32")])
    if header.kind != "u":
        raise ScanError(f"a VTK file's header_type is UInt32 or UInt64, got {header}; export it again")
    in_base64 = split is not None and b"base64" in split[0]
    return tree, _File(order, header, _decompressor(tree.get("compressor", "")), appended, in_base64)


def _decompressor(name: str) -> Callable[[bytes, int], bytes] | None:
    """The function that decompresses a block to at most a given number of bytes; None without compression."""
    match name:
        case "":
            return None
        case "vtkZLibDataCompressor":
            return lambda block, most: zlib.decompressobj().decompress(block, most)
        case "vtkLZMADataCompressor":
            return lambda block, most: lzma.LZMADecompressor().decompress(block, most)
    raise ScanError(f"the VTK file is packed by {name[:40]}, which is not read here; save it again with ZLib")


def _read_points(piece: ElementTree.Element, file: _File) -> np.ndarray:
    """The points (N, 3) float64 of a piece."""
    count = int(piece.get("NumberOfPoints", "0"))
    array = piece.find("Points/DataArray")
    if array is None:
        raise ScanError(f"the VTK file promises {count} points and has no array of them; export it again")
    if array.get("NumberOfComponents", "3") != "3":
        raise ScanError(f"VTK points have three numbers each, got {array.get('NumberOfComponents')}; export it again")
    numbers = _read_numbers(array, 3 * count, file).astype(np.float64)
    if len(numbers) != 3 * count:
        raise ScanError(f"the VTK file promises {count} points, and {len(numbers)} numbers came; export it again")
    return numbers.reshape(-1, 3)


def _read_numbers(array: ElementTree.Element, expected: int, file: _File) -> np.ndarray:
    """The numbers (M,) of an array; `expected` is how many a packed one has."""
    kind = np.dtype(file.order + _NUMPY_TYPES[array.get("type", "Float32")])
    form = array.get("format", "ascii")
    if form == "ascii":
        numbers = np.array((array.text or "").split(), dtype=np.float64)
        return numbers.astype(kind.newbyteorder("=")) if kind.kind in "iu" else numbers
    if form == "appended":
        stream, in_base64 = file.appended[int(array.get("offset", "0")) :], file.in_base64
    else:
        stream, in_base64 = (array.text or "").strip().encode(), True
    return np.frombuffer(_read_array(stream, in_base64, file, expected * kind.itemsize), kind)


def _read_array(stream: bytes, in_base64: bool, file: _File, expected: int) -> bytes:
    """The `expected` bytes of the array at the beginning of a stream, behind the lengths of it or its blocks."""
    word = file.header.itemsize
    if file.unpack is None:
        taken = _take_bytes(stream, in_base64, word)
        announced = int(np.frombuffer(taken, file.header, 1)[0])
        if announced != expected:
            raise ValueError(f"{expected} bytes of points expected, {announced} came")
        # some writers encode the length by itself
        separate_length = in_base64 and b"=" in stream[: _base64_length(word)]
        if separate_length:
            return _take_bytes(stream[_base64_length(word) :], True, expected)
        return _take_bytes(stream, in_base64, word + expected)[word:]
    lengths = np.frombuffer(_take_bytes(stream, in_base64, 3 * word), file.header, 3)
    blocks, size, last = (int(number) for number in lengths)
    if blocks == 0 or (blocks - 1) * size + (last or size) != expected or blocks * word > len(stream):
        raise ValueError(f"{expected} bytes of points expected, and {blocks} blocks of {size} came")
    head = (3 + blocks) * word
    packed = np.frombuffer(_take_bytes(stream, in_base64, head), file.header, 3 + blocks)[3:].astype(np.int64)
    body = _take_bytes(stream[_base64_length(head) if in_base64 else head :], in_base64, int(packed.sum()))
    ends = np.cumsum(packed)
    return b"".join(file.unpack(body[end - length : end], size) for end, length in zip(ends, packed, strict=True))


def _base64_length(size: int) -> int:
    """Characters of base64 that encode `size` bytes."""
    return 4 * -(-size // 3)


def _take_bytes(stream: bytes, in_base64: bool, size: int) -> bytes:
    """The first `size` bytes of a stream.

    Raises:
        ValueError: the stream is shorter.
    """
    taken = stream[:size]
    if in_base64:
        letters = stream[: _base64_length(size)]
        end = letters.find(b"=")
        if 0 <= end < len(letters) - 4:  # parted streams: no more than the first is meant
            letters = letters[: -(-(end + 1) // 4) * 4]
        taken = base64.b64decode(letters)[:size]
    if len(taken) != size:
        raise ValueError(f"an array of {size} bytes ends after {len(taken)}")
    return taken
