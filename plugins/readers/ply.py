"""Vertices of a PLY file: ascii, binary of either byte order, cloud or mesh."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from z2p_core.formats.ply_header import LONGEST_HEADER, PlyElement, PlyHeader, parse_header
from z2p_core.formats.row_subsampling import BLOCK_BYTES, MAX_ROWS, subsample_points
from z2p_core.interfaces import MEMORY_A_CHARACTER, MEMORY_A_POINT, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._cameras.camera_hints import read_3dgs_cameras, with_camera_hints
from z2p_renderer.plugins.readers._cameras.model_cameras import with_model_cameras
from z2p_renderer.plugins.readers._helpers.color_note import colours_note
from z2p_renderer.plugins.readers._helpers.gaussian_splats import (
    cloud_from_packed_splats,
    cloud_from_splats,
    is_packed,
    is_splats,
    splat_columns,
)
from z2p_renderer.plugins.readers._helpers.length_check import (
    MAX_TRAILING_BYTES,
    check_trailing_bytes,
    trailing_bytes_note,
)
from z2p_renderer.plugins.readers._helpers.ply_lists import parse_ascii_lists, parse_binary_lists


class Ply(Reader):
    """Polygon files, and Gaussian splats in them; faces, edges and further properties are left out."""

    name = "ply"
    version = "3"
    takes_columns = False
    suffixes = (".ply",)

    def memory(self, path: Path) -> int:
        """Memory for the points that the header promises and for their rows; text takes far more."""
        with path.open("rb") as file:
            head = file.read(LONGEST_HEADER)
        try:
            header = parse_header(head)
            _check_length(header, path.stat().st_size)
            if is_packed(header):
                return 2 * path.stat().st_size + MAX_ROWS * MEMORY_A_POINT
            vertex = _find_vertex(header)
        except ScanError:
            return 0  # read reports the error
        if header.ascii:
            return MEMORY_A_CHARACTER * path.stat().st_size
        if not _has_fixed_offsets(header, vertex):
            return vertex.count * MEMORY_A_POINT + 2 * path.stat().st_size
        if vertex.count > MAX_ROWS:
            return MAX_ROWS * MEMORY_A_POINT + 2 * BLOCK_BYTES
        return vertex.count * MEMORY_A_POINT + 2 * vertex.least_bytes(ascii=False)

    def read(self, path: Path) -> list[RawCloud]:
        """The file's vertices, one cloud (N, 3) float64; very large binary files are subsampled.

        Raises:
            ScanError: no PLY file, no x, y, z, or a header that promises another size than the file has.
        """
        cloud = _read_cloud(path)
        if cloud.up:  # only Gaussians have one
            return [with_camera_hints(cloud, *read_3dgs_cameras(path))]
        return [with_model_cameras(cloud, path)]


def _read_cloud(path: Path) -> RawCloud:
    with path.open("rb") as file:
        header = parse_header(file.read(LONGEST_HEADER))
        note = trailing_bytes_note(_check_length(header, path.stat().st_size))
        file.seek(header.size)
        if is_packed(header):
            return cloud_from_packed_splats(file.read(), header, note)
        vertex = _find_vertex(header)
        if vertex.count == 0:
            return RawCloud(np.empty((0, 3)))
        splats = vertex.scalar and is_splats(vertex)
        columns = (*_axis_names(vertex), *(splat_columns(vertex) if splats else ()))
        note = note if splats else "; ".join(filter(None, [note, colours_note(_scalar_names(vertex))]))
        if header.ascii:
            table = _parse_ascii(vertex, _read_ascii_rows(file, header, vertex), columns)
            return cloud_from_splats(table, vertex.count, note) if splats else RawCloud(table, note=note)
        if not _has_fixed_offsets(header, vertex):
            return RawCloud(parse_binary_lists(file.read(), header, vertex, _axis_names(vertex)), note=note)
        _seek_vertices(file, header, vertex)
        if splats or vertex.count > MAX_ROWS:
            return _read_subsampled(file, vertex, columns, note)
        points = _parse_binary(vertex, file.read(vertex.least_bytes(ascii=False)), columns).astype(np.float64)
    return RawCloud(points, note=note)


def _check_length(header: PlyHeader, size: int) -> int:
    """The number of trailing bytes behind the data that the header promises; 0 if their size is not known.

    Raises:
        ScanError: the file is shorter, or so much longer that the header may have lost a property.
    """
    if header.ascii or not all(element.scalar for element in header.elements):
        header.check_size(size)
        return 0
    promise = f"the PLY header promises {', '.join(f'{element.count} {element.name}' for element in header.elements)}"
    expected = sum(element.least_bytes(ascii=False) for element in header.elements)
    max_count = max([0, *(element.count - 1 for element in header.elements)])  # a lost property has a byte per row
    return check_trailing_bytes(promise, expected, size - header.size, min(max_count, MAX_TRAILING_BYTES))


def _find_vertex(header: PlyHeader) -> PlyElement:
    """The element that holds the points, checked for x, y, z."""
    vertex = header.element("vertex")
    known = ", ".join(element.name for element in header.elements) or "none"
    if vertex is None:
        raise ScanError(f"the PLY file has no element 'vertex' (elements: {known}); export the points as vertices")
    names = _scalar_names(vertex)
    if any(names.count(axis) != 1 for axis in _axis_names(vertex)) or len(set(names)) != len(names):
        raise ScanError(f"the PLY vertices need x, y and z once each, got {', '.join(names) or 'none'}; export again")
    return vertex


def _axis_names(vertex: PlyElement) -> tuple[str, ...]:
    """Names of the coordinates: some programs write them in capitals."""
    return tuple("XYZ") if set(_scalar_names(vertex)).isdisjoint("xyz") else tuple("xyz")


def _scalar_names(vertex: PlyElement) -> list[str]:
    """Names of the properties that are not lists."""
    return [entry.name for entry in vertex.properties if entry.length is None]


def _has_fixed_offsets(header: PlyHeader, vertex: PlyElement) -> bool:
    """Whether vertices are at known offsets in a binary file: there is no list before or among them."""
    return all(element.scalar for element in header.elements[: header.elements.index(vertex) + 1])


def _read_subsampled(file: io.BufferedReader, vertex: PlyElement, columns: tuple[str, ...], note: str) -> RawCloud:
    """Subsamples the vertex rows, which are read in blocks; of Gaussians, those that show a surface are kept."""

    def read(rows: int) -> np.ndarray:
        return _parse_binary(vertex, file.read(rows * vertex.dtype.itemsize), columns)

    table = subsample_points(read, vertex.count, vertex.dtype.itemsize, np.random.default_rng(0), MAX_ROWS)
    if len(columns) > 3:
        return cloud_from_splats(table, vertex.count, note)
    return RawCloud(table, total=vertex.count, note=note)


def _seek_vertices(file: io.BufferedReader, header: PlyHeader, vertex: PlyElement) -> None:
    """Moves a binary file from the end of the header to the first vertex row."""
    before = header.elements[: header.elements.index(vertex)]
    file.seek(sum(element.least_bytes(ascii=False) for element in before), io.SEEK_CUR)


def _read_ascii_rows(file: io.BufferedReader, header: PlyHeader, vertex: PlyElement) -> list[bytes]:
    before = sum(element.count for element in header.elements[: header.elements.index(vertex)])
    lines = [line for line in file.read().splitlines() if line.strip()]
    rows = lines[before : before + vertex.count]
    if len(rows) != vertex.count:
        raise ScanError(f"the PLY header promises {vertex.count} vertices, {len(rows)} lines came; "
                        "the file is cut short: export it again")
    return rows


def _parse_ascii(vertex: PlyElement, lines: list[bytes], columns: tuple[str, ...]) -> np.ndarray:
    """Numbers (N, len(columns)) float64 of the vertex rows."""
    try:
        if not vertex.scalar:
            return parse_ascii_lists(lines, vertex, _axis_names(vertex))
        rows = np.loadtxt(io.BytesIO(b"\n".join(lines)), comments=None, ndmin=2)
        names = [entry.name for entry in vertex.properties]
        if rows.shape[1] != len(names):
            raise ValueError(f"{len(names)} numbers a line expected, {rows.shape[1]} came")
        return rows[:, [names.index(column) for column in columns]]
    except ValueError as error:
        raise ScanError(f"the PLY vertices cannot be read ({error}); export the file again") from error


def _parse_binary(vertex: PlyElement, rows: bytes, columns: tuple[str, ...]) -> np.ndarray:
    """Numbers (N, len(columns)) of whole binary rows, in a common type."""
    table = np.frombuffer(rows, vertex.dtype)
    return np.column_stack([table[column] for column in columns])
