"""Vertices of a PLY file: ascii, binary of either byte order, cloud or mesh."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from z2p_core.formats.ply_header import LONGEST_HEADER, PlyElement, PlyHeader, parse_header
from z2p_core.formats.row_subsampling import BLOCK_BYTES, ThinnedRows, subsample_blocks
from z2p_core.interfaces import MEMORY_A_CHARACTER, MEMORY_A_POINT, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._cameras.camera_hints import read_3dgs_cameras, with_camera_hints
from z2p_renderer.plugins.readers._cameras.model_cameras import with_model_cameras
from z2p_renderer.plugins.readers._helpers.gaussian_splats import (
    cloud_from_packed_splats,
    cloud_from_splats,
    is_packed,
    is_splats,
    plan_splats,
    splat_columns,
)
from z2p_renderer.plugins.readers._helpers.length_check import (
    MAX_TRAILING_BYTES,
    check_trailing_bytes,
    trailing_bytes_note,
)
from z2p_renderer.plugins.readers._helpers.ply_lists import parse_ascii_lists, parse_binary_lists
from z2p_renderer.plugins.readers._helpers.point_fields import Wants, plan_fields

_MAX_WHOLE_ROW_BYTES = 64
"""Longer rows, such as those of Gaussian splats, are read in blocks."""
_BLOCK_CHARACTERS = 1 << 22
"""Text that is parsed at a time."""


class Ply(Reader):
    """Polygon files, and Gaussian splats in them; faces, edges and lists of the vertices are left out."""

    name = "ply"
    version = "5"
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
                return 2 * path.stat().st_size + self.max_rows * MEMORY_A_POINT
            vertex = _find_vertex(header)
        except ScanError:
            return 0  # read reports the error
        if header.ascii:
            size = path.stat().st_size
            points = min(vertex.count, size, 2 * self.max_rows)
            return points * MEMORY_A_POINT + min(size, 2 * _BLOCK_CHARACTERS) * MEMORY_A_CHARACTER
        if not _has_fixed_offsets(header, vertex):
            return vertex.count * MEMORY_A_POINT + 2 * path.stat().st_size
        if vertex.count > self.max_rows:
            return self.max_rows * MEMORY_A_POINT + 2 * BLOCK_BYTES
        return vertex.count * MEMORY_A_POINT + 2 * vertex.least_bytes(ascii=False)

    def read(self, path: Path) -> list[RawCloud]:
        """The file's vertices, one cloud (N, 3) float64; very large files are subsampled.

        Raises:
            ScanError: no PLY file, no x, y, z, or a header that promises another size than the file has.
        """
        cloud = _read_cloud(path, self.wants, self.max_rows)
        if cloud.up:  # only Gaussians have one
            return [with_camera_hints(cloud, *read_3dgs_cameras(path))]
        return [with_model_cameras(cloud, path)]


def _read_cloud(path: Path, wants: Wants, max_rows: int) -> RawCloud:
    with path.open("rb") as file:
        header = parse_header(file.read(LONGEST_HEADER))
        note = trailing_bytes_note(_check_length(header, path.stat().st_size))
        file.seek(header.size)
        if is_packed(header):
            return cloud_from_packed_splats(file.read(), header, wants, note)
        vertex = _find_vertex(header)
        if vertex.count == 0:
            return RawCloud(np.empty((0, 3)))
        splats = vertex.scalar and is_splats(vertex)
        names, axes = _scalar_names(vertex), _axis_names(vertex)
        plan = (plan_splats if splats else plan_fields)(names, wants, [names.index(axis) for axis in axes])
        needed = [names[column] for column in plan.columns]
        columns = tuple(dict.fromkeys((*axes, *(splat_columns(vertex) if splats else ()), *needed)))
        table = _read_columns(file, header, vertex, columns, max_rows)
    points = np.column_stack([table[axis] for axis in axes]).astype(np.float64)
    total = vertex.count if len(points) < vertex.count else None
    cloud = plan.fill(RawCloud(points, total=total, note=note), {names.index(name): table[name] for name in needed})
    if splats:
        opacity, *scales = (table[name] for name in splat_columns(vertex))
        return cloud_from_splats(cloud, opacity, scales, vertex.count)
    return cloud


def _read_columns(
    file: io.BufferedReader, header: PlyHeader, vertex: PlyElement, columns: tuple[str, ...], max_rows: int
) -> dict[str, np.ndarray]:
    """The columns (N,) of these names, in the types that the header tells; of very large files a subsample."""
    if header.ascii:
        return _typed(_read_ascii(file, header, vertex, columns, max_rows), vertex, columns)
    if not _has_fixed_offsets(header, vertex):
        return _typed(parse_binary_lists(file.read(), header, vertex, columns), vertex, columns)
    _seek_vertices(file, header, vertex)
    if vertex.count > max_rows or vertex.dtype.itemsize > _MAX_WHOLE_ROW_BYTES:
        return _read_subsampled(file, vertex, columns, max_rows)
    table = np.frombuffer(file.read(vertex.least_bytes(ascii=False)), vertex.dtype)
    return {name: table[name] for name in columns}


def _typed(table: np.ndarray, vertex: PlyElement, columns: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The columns of numbers (N, len(columns)) float64: integers that the header tells are made such again."""
    kinds = {entry.name: entry.type.newbyteorder("=") for entry in vertex.properties if entry.length is None}
    typed = {}
    for column, name in enumerate(columns):
        values, kind = table[:, column], kinds[name]
        if kind.kind in "iu":
            limits = np.iinfo(kind)
            fits = len(values) == 0 or (limits.min <= values.min() and values.max() <= limits.max)
            typed[name] = values.astype(kind) if fits and not (values % 1).any() else values
        else:
            typed[name] = values
    return typed


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


def _read_subsampled(
    file: io.BufferedReader, vertex: PlyElement, columns: tuple[str, ...], max_rows: int
) -> dict[str, np.ndarray]:
    """Reads the vertex rows in blocks, a subsample of very many."""
    size = vertex.dtype.itemsize
    parts: dict[str, list[np.ndarray]] = {name: [] for name in columns}
    for rows, kept in subsample_blocks(vertex.count, size, np.random.default_rng(0), max_rows):
        block = np.frombuffer(file.read(rows * size), vertex.dtype)
        for name, part in parts.items():
            part.append(block[name][kept])
    return {name: np.concatenate(part) for name, part in parts.items()}


def _seek_vertices(file: io.BufferedReader, header: PlyHeader, vertex: PlyElement) -> None:
    """Moves a binary file from the end of the header to the first vertex row."""
    before = header.elements[: header.elements.index(vertex)]
    file.seek(sum(element.least_bytes(ascii=False) for element in before), io.SEEK_CUR)


def _read_ascii(
    file: io.BufferedReader, header: PlyHeader, vertex: PlyElement, columns: tuple[str, ...], max_rows: int
) -> np.ndarray:  # fmt: skip
    """Numbers (M, len(columns)) float64 of the vertex rows, of at most `max_rows` of them, from behind the header on.

    Raises:
        ScanError: fewer rows than the header promises, or rows with other numbers.
    """
    before = sum(element.count for element in header.elements[: header.elements.index(vertex)])
    thinned, came = ThinnedRows(len(columns), max_rows, vertex.count), -before
    while came < vertex.count and (block := file.read(_BLOCK_CHARACTERS)):
        lines = [line for line in (block + file.readline()).splitlines() if line.strip()]
        rows = lines[max(-came, 0) : vertex.count - came]
        came += len(lines)
        chosen = thinned.choose(len(rows))
        if chosen is not None:
            rows = [rows[row] for row in chosen]
        if rows:
            thinned.keep(_parse_ascii(vertex, rows, columns))
    if came < vertex.count:
        raise ScanError(f"the PLY header promises {vertex.count} vertices, {max(came, 0)} lines came; "
                        "the file is cut short: export it again")
    return thinned.table()


def _parse_ascii(vertex: PlyElement, lines: list[bytes], columns: tuple[str, ...]) -> np.ndarray:
    """Numbers (N, len(columns)) float64 of the vertex rows."""
    try:
        if not vertex.scalar:
            return parse_ascii_lists(lines, vertex, columns)
        rows = np.loadtxt(io.BytesIO(b"\n".join(lines)), comments=None, ndmin=2)
        names = [entry.name for entry in vertex.properties]
        if rows.shape[1] != len(names):
            raise ValueError(f"{len(names)} numbers a line expected, {rows.shape[1]} came")
        return rows[:, [names.index(column) for column in columns]]
    except ValueError as error:
        raise ScanError(f"the PLY vertices cannot be read ({error}); export the file again") from error
