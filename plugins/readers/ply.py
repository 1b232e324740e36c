"""Vertices of a PLY file: ascii, binary of either byte order, cloud or mesh."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from z2p_core.interfaces import MEMORY_A_CHARACTER, MEMORY_A_POINT, RawCloud, Reader, ScanError
from z2p_core.ply_header import LONGEST_HEADER, PlyElement, PlyHeader, parse_header
from z2p_core.spread import BLOCK, MOST_ROWS, spread_points


class Ply(Reader):
    """Polygon files; faces, edges and further properties are left out."""

    name = "ply"
    version = "1"
    suffixes = (".ply",)

    def memory(self, path: Path) -> int:
        """As many points as the header promises, and their rows; text takes far more."""
        with path.open("rb") as file:
            head = file.read(LONGEST_HEADER)
        try:
            header = parse_header(head)
            header.check_size(path.stat().st_size)
            vertex = _vertex(header)
        except ScanError:
            return 0  # read says what is wrong
        if header.ascii:
            return MEMORY_A_CHARACTER * path.stat().st_size
        if vertex.count > MOST_ROWS:
            return MOST_ROWS * MEMORY_A_POINT + 2 * BLOCK
        return vertex.count * MEMORY_A_POINT + 2 * vertex.least_bytes(ascii=False)

    def read(self, path: Path) -> list[np.ndarray | RawCloud]:
        """The file's vertices, one cloud (N, 3) float64; of very many in a binary file, some that stand for all.

        Raises:
            ScanError: no PLY file, no x, y, z, or a header that promises another size than the file has.
        """
        with path.open("rb") as file:
            header = parse_header(file.read(LONGEST_HEADER))
            header.check_size(path.stat().st_size)
            vertex = _vertex(header)
            if vertex.count == 0:
                return [np.empty((0, 3))]
            file.seek(header.size)
            if vertex.count > MOST_ROWS and not header.ascii:
                return [_spread(file, header, vertex)]
            body = _rows_ascii(file, header, vertex) if header.ascii else _rows_binary(file, header, vertex)
        return [_load(header, vertex, body)]


def _vertex(header: PlyHeader) -> PlyElement:
    """The element that holds the points, checked for x, y, z and for rows that can be told apart."""
    vertex = header.element("vertex")
    known = ", ".join(element.name for element in header.elements) or "none"
    if vertex is None:
        raise ScanError(f"the PLY file has no element 'vertex' (elements: {known}); export the points as vertices")
    names = [entry.name for entry in vertex.properties if entry.length is None]
    if any(names.count(axis) != 1 for axis in "xyz") or len(set(names)) != len(names):
        raise ScanError(f"the PLY vertices need x, y and z once each, got {', '.join(names) or 'none'}; export again")
    ahead = header.elements[: header.elements.index(vertex)]
    if not vertex.scalar or not (header.ascii or all(element.scalar for element in ahead)):
        raise ScanError("lists stand before or among the PLY vertices, so they cannot be found; "
                        "save the file again with plain vertices first, e.g. from MeshLab or CloudCompare")
    return vertex


def _rows_binary(file: io.BufferedReader, header: PlyHeader, vertex: PlyElement) -> bytes:
    _seek(file, header, vertex)
    return file.read(vertex.least_bytes(ascii=False))


def _spread(file: io.BufferedReader, header: PlyHeader, vertex: PlyElement) -> RawCloud:
    """Points spread over the vertex rows, read in blocks."""
    _seek(file, header, vertex)

    def read(rows: int) -> np.ndarray:
        return _table(vertex, file.read(rows * vertex.dtype.itemsize))

    points = spread_points(read, vertex.count, vertex.dtype.itemsize, np.random.default_rng(0), MOST_ROWS)
    return RawCloud(points, total=vertex.count)


def _seek(file: io.BufferedReader, header: PlyHeader, vertex: PlyElement) -> None:
    """Goes on from the header's end to the first vertex row of a binary file."""
    before = header.elements[: header.elements.index(vertex)]
    file.seek(sum(element.least_bytes(ascii=False) for element in before), io.SEEK_CUR)


def _rows_ascii(file: io.BufferedReader, header: PlyHeader, vertex: PlyElement) -> bytes:
    before = sum(element.count for element in header.elements[: header.elements.index(vertex)])
    lines = [line for line in file.read().splitlines() if line.strip()]
    rows = lines[before : before + vertex.count]
    if len(rows) != vertex.count:
        raise ScanError(f"the PLY header promises {vertex.count} vertices, {len(rows)} lines came; "
                        "the file is cut short: export it again")
    return b"\n".join(rows) + b"\n"


def _load(header: PlyHeader, vertex: PlyElement, body: bytes) -> np.ndarray:
    """Points (N, 3) float64 of the vertex rows."""
    try:
        if header.ascii:
            rows = np.loadtxt(io.BytesIO(body), comments=None, ndmin=2)
            names = [entry.name for entry in vertex.properties]
            if rows.shape[1] != len(names):
                raise ValueError(f"{len(names)} numbers a line expected, {rows.shape[1]} came")
            return rows[:, [names.index(axis) for axis in "xyz"]]
        return _table(vertex, body).astype(np.float64)
    except ValueError as error:
        raise ScanError(f"the PLY vertices cannot be read ({error}); export the file again") from error


def _table(vertex: PlyElement, rows: bytes) -> np.ndarray:
    """Points (N, 3) of whole binary rows, in the type of x, y and z."""
    table = np.frombuffer(rows, vertex.dtype)
    return np.column_stack([table[axis] for axis in "xyz"])
