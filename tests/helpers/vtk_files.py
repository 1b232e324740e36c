"""Small VTK files, written as VTK's own writers do."""

from __future__ import annotations

import base64
import zlib

import numpy as np


def legacy(points: np.ndarray, binary: bool, kind: str = "PolyData", extra: bytes = b"") -> bytes:
    """A .vtk file; binary numbers are big-endian."""
    name = {"PolyData": b"POLYDATA", "UnstructuredGrid": b"UNSTRUCTURED_GRID"}[kind]
    head = b"# vtk DataFile Version 3.0\nmade by hand\n" + (b"BINARY" if binary else b"ASCII") + b"\nDATASET " + name
    body = points.astype(">f8").tobytes() if binary else " ".join(map(repr, points.ravel().tolist())).encode()
    return head + extra + f"\nPOINTS {len(points)} double\n".encode() + body + b"\nVERTICES 1 2\n1 0\n"


def encoded(blob: bytes, form: str, packed: bool, header: str) -> bytes:
    """An array's bytes with its length before them, or the lengths of packed blocks of 100 bytes."""
    word = np.dtype({"UInt32": "<u4", "UInt64": "<u8"}[header])
    if not packed:
        whole = np.array([len(blob)], word).tobytes() + blob
        return whole if form == "raw" else base64.b64encode(whole)
    size = 100
    blocks = [zlib.compress(blob[start : start + size]) for start in range(0, len(blob), size)]
    head = np.array([len(blocks), size, len(blob) % size, *map(len, blocks)], word).tobytes()
    if form == "raw":
        return head + b"".join(blocks)
    return base64.b64encode(head) + base64.b64encode(b"".join(blocks))


def xml(
    points: np.ndarray, form: str = "ascii", packed: bool = False, header: str = "UInt32", kind: str = "PolyData",
    pieces: int = 1, appended_as: str = "raw",
) -> bytes:  # fmt: skip
    """A .vtp or .vtu file whose points are text, in base64 (``binary``), or ``appended`` behind the text."""
    compressor = ' compressor="vtkZLibDataCompressor"' if packed else ""
    text, appended = "", b""
    for part in np.array_split(points, pieces):
        blob = part.astype("<f8").tobytes()
        inner, place = "", ""
        if form == "ascii":
            inner = " ".join(map(repr, part.ravel().tolist()))
        elif form == "binary":
            inner = encoded(blob, "base64", packed, header).decode()
        else:
            place = f' offset="{len(appended)}"'
            appended += encoded(blob, appended_as, packed, header)
        array = f'<DataArray type="Float64" NumberOfComponents="3" format="{form}"{place}>{inner}</DataArray>'
        text += f'<Piece NumberOfPoints="{len(part)}"><Points>{array}</Points></Piece>'
    tail = b""
    if form == "appended":
        tail = f'<AppendedData encoding="{appended_as}">\n _'.encode() + appended + b"\n</AppendedData>"
    told = f'type="{kind}" byte_order="LittleEndian" header_type="{header}"{compressor}'
    return f'<?xml version="1.0"?>\n<VTKFile {told}><{kind}>{text}</{kind}>'.encode() + tail + b"</VTKFile>"
