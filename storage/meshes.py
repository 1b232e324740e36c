"""Meshes on disk: reads them as triangles, judges how they want to be shaded, writes meshes and clouds as PLY."""

from __future__ import annotations

import stat
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.formats.ply_header import LONGEST_HEADER, PlyElement, PlyHeader, parse_header
from z2p_core.interfaces import ScanError
from z2p_renderer.storage.files.printable_names import is_folder, printable

MESH_SUFFIXES = (".ply", ".obj", ".off", ".stl", ".glb")

MIN_FACET_ANGLE_DEGREES = 23.0
MAX_FACETED_FACES = 20_000
"""`is_smooth_surface`: facets are meant from this typical angle on, and visible as such below this count of faces."""


@dataclass(frozen=True)
class Mesh:
    """Triangles in the file's own units.

    vertices (V, 3) float64, finite; faces (M, 3) int64 in [0, V), some of them with an area; `smooth` tells whether
    they stand for a curved surface (normals joined across edges) or are facets to be seen.
    """

    vertices: np.ndarray
    faces: np.ndarray
    smooth: bool


def read_mesh(path: Path) -> Mesh:
    """The triangles of a mesh file; polygons are cut into fans, scenes joined into one mesh.

    Vertices stay as PLY and OFF files list them. In STL, OBJ and GLB, vertices at exactly one place become one:
    these formats, or their loader, repeat a vertex for each triangle or texture seam, which no smooth shading survives.

    Raises:
        ScanError: unknown suffix, unreadable file, no faces, vertices that are not finite, face indices outside the
            vertices, or no face with an area.
    """
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise ScanError(f"{printable(path)}: unknown mesh format {suffix!r}; readable: {', '.join(MESH_SUFFIXES)}")
    try:
        check_openable(path)
        vertices, faces = _load(path, suffix)
        faces = _check_faces(vertices, faces)
    except ScanError as error:
        raise ScanError(f"{printable(path)}: {error}") from error
    except Exception as error:  # trimesh raises whatever its parsing stumbles over
        message = f"{printable(path)}: not a readable {suffix} mesh ({error_reason(error)}); export it again"
        raise ScanError(message) from error
    if suffix in (".stl", ".obj", ".glb"):
        vertices, faces = _merge_vertices(vertices, faces)
    return Mesh(vertices, faces, is_smooth_surface(vertices, faces))


def find_meshes(folder: Path) -> dict[str, Path]:
    """The meshes in a folder (not below it, nor hidden), sorted, by stem, or by file name where two share a stem.

    Raises:
        ScanError: no such folder, or no mesh in it.
    """
    if not is_folder(folder):
        raise ScanError(f"expected a folder of meshes, got {printable(folder)}, which is no folder; check the path")
    visible = [path for path in folder.iterdir() if not path.name.startswith(".")]  # as ._cow.obj, which macOS leaves
    paths = sorted(path for path in visible if path.suffix.lower() in MESH_SUFFIXES and path.is_file())
    if not paths:
        raise ScanError(f"folder {printable(folder)} holds no mesh; readable: {', '.join(MESH_SUFFIXES)}")
    taken = Counter(path.stem for path in paths) + Counter(path.name for path in paths)  # a.ply is a stem in a.ply.ply
    return {path.stem if taken[path.stem] == 1 else path.name: path for path in paths}


def is_smooth_surface(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether triangles faces (M, 3) int of vertices (V, 3) float64 stand for a curved surface.

    They do unless the typical angle between neighbouring faces (median over shared edges, weighted by their length) is
    `MIN_FACET_ANGLE_DEGREES` or more and there are fewer than `MAX_FACETED_FACES`: a dense scan with large angles is
    noisy, not faceted. A curved surface cut into that few triangles shows its facets however it is shaded. Flat sides
    with sharp edges between them (most CAD) count as smooth: their triangles meet at 0 degrees, and the renderer parts
    the normals at sharp edges anyway.
    """
    if len(faces) >= MAX_FACETED_FACES:
        return True
    angles, lengths = _edge_angles(*_merge_vertices(vertices, faces))
    if len(angles) == 0:
        return True
    order = np.argsort(angles, kind="stable")
    reached = np.cumsum(lengths[order])
    median = angles[order][np.searchsorted(reached, reached[-1] / 2)]
    return bool(median < np.radians(MIN_FACET_ANGLE_DEGREES))


def write_mesh(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Binary PLY of vertices (V, 3), kept as float64, and triangles (M, 3); same arrays, same bytes."""
    points, head = _vertex_block(np.asarray(vertices, dtype=np.float64))
    rows = np.empty(len(faces), dtype=[("count", "u1"), ("indices", "<i4", (3,))])
    rows["count"], rows["indices"] = 3, np.asarray(faces).reshape(-1, 3)
    head += f"element face {len(rows)}\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_bytes(head.encode() + points.tobytes() + rows.tobytes())


def write_cloud(path: Path, points: np.ndarray) -> None:
    """Binary PLY of points (N, 3), float32 when they come as float32 and else float64; same array, same bytes."""
    rows, head = _vertex_block(np.asarray(points))
    path.write_bytes(f"{head}end_header\n".encode() + rows.tobytes())


def check_openable(path: Path) -> None:
    """Nothing, when the path is a file that may be read.

    Raises:
        ScanError: it is missing, not a file, or may not be read.
    """
    try:
        regular = stat.S_ISREG(path.stat().st_mode)
        if regular:  # opening a pipe would wait for ever
            path.open("rb").close()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScanError(f"cannot be opened ({reason}); check that it exists and may be read") from error
    if not regular:
        raise ScanError("expected a file, got a folder or a device")


def _vertex_block(points: np.ndarray) -> tuple[np.ndarray, str]:
    """Rows as a PLY file holds them, and its header up to them."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"expected points (N, 3), got {points.shape}")
    kind, dtype = ("float", "<f4") if points.dtype == np.float32 else ("double", "<f8")
    axes = "".join(f"property {kind} {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{axes}"
    return np.ascontiguousarray(points, dtype=dtype), head


def _load(path: Path, suffix: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64 and triangles (M, 3) int64, unchecked."""
    from trimesh.geometry import triangulate_quads

    if suffix == ".ply":
        vertices, polygons = _load_ply(path)
    elif suffix == ".off":
        from trimesh.exchange.off import load_off

        with path.open("rb") as file:
            mesh = load_off(file)
        vertices, polygons = mesh["vertices"], mesh["faces"]
    else:
        import trimesh

        loaded = trimesh.load_mesh(path, process=False, skip_materials=True)
        vertices, polygons = loaded.vertices, loaded.faces
    return np.array(vertices, dtype=np.float64), triangulate_quads(polygons).reshape(-1, 3)


def _load_ply(path: Path) -> tuple[np.ndarray, np.ndarray | list[np.ndarray]]:
    """Vertices and polygons of a PLY file: trimesh's reading of ascii, ours of binary.

    trimesh takes all polygons of a binary file to have the size of the first, which modelling programs do not keep to.
    """
    blob = path.read_bytes()
    header = parse_header(blob[:LONGEST_HEADER])
    header.check_size(len(blob))
    vertex, face = header.element("vertex"), header.element("face")
    if vertex is None or face is None or face.count == 0:
        raise ScanError("the file has no faces; a mesh is expected here, not a point cloud")
    if not header.ascii:
        return _binary_ply(blob, header)
    from trimesh.exchange.ply import load_ply

    with path.open("rb") as file:
        mesh = load_ply(file, fix_texture=False, skip_materials=True)
    return mesh["vertices"], mesh["faces"]


def _binary_ply(blob: bytes, header: PlyHeader) -> tuple[np.ndarray, np.ndarray | list[np.ndarray]]:
    vertices: np.ndarray | None = None
    offset = header.size
    for element in header.elements:
        if element.name == "face" and vertices is not None:
            return vertices, _polygons(blob, offset, element)
        if not element.scalar:
            break
        if element.name == "vertex":
            rows = np.frombuffer(blob, element.dtype, element.count, offset)
            vertices = np.column_stack([rows[axis] for axis in "xyz"])
        offset += element.least_bytes(ascii=False)
    raise ScanError("expected plain vertices, then faces; save the file again, e.g. from Blender or MeshLab")


def _polygons(blob: bytes, offset: int, face: PlyElement) -> np.ndarray | list[np.ndarray]:
    """Vertex indices of each polygon: one array (M, sides) when all have the first one's size, else a list."""
    lists = [entry for entry in face.properties if entry.length is not None]
    wanted = next((entry for entry in lists if entry.name in ("vertex_indices", "vertex_index")), None)
    if wanted is None:
        raise ScanError("the PLY faces have no list 'vertex_indices'; export the file again")
    if lists == list(face.properties) and len(lists) == 1 and wanted.length is not None:
        sides = int(_values(blob, wanted.length, 1, offset)[0])
        row = np.dtype([("sides", wanted.length), ("indices", wanted.type, (max(sides, 0),))])
        if len(blob) - offset == face.count * row.itemsize:
            rows = np.frombuffer(blob, row, face.count, offset)
            if (rows["sides"] == sides).all():
                return rows["indices"]
    polygons = []
    for _ in range(face.count):
        for entry in face.properties:
            count = 1
            if entry.length is not None:
                count = int(_values(blob, entry.length, 1, offset)[0])
                offset += entry.length.itemsize
            values = _values(blob, entry.type, count, offset)
            offset += values.nbytes
            if entry is wanted:
                polygons.append(values)
    return polygons


def _values(blob: bytes, dtype: np.dtype, count: int, offset: int) -> np.ndarray:
    """`count` numbers of a face, from `offset` on."""
    if not 0 <= count * dtype.itemsize <= len(blob) - offset:
        raise ScanError("a PLY face reaches past the end of the file; export it again")
    return np.frombuffer(blob, dtype, count, offset)


def _check_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The faces as int64, once they are known to be safe: Blender crashes on an index out of range."""
    if len(faces) == 0:
        raise ScanError("the file has no faces; a mesh is expected here, not a point cloud")
    broken = int((~np.isfinite(vertices).all(axis=1)).sum())
    if broken:
        raise ScanError(f"{broken} of {len(vertices)} vertices are not finite; repair the mesh")
    faces = np.asarray(faces).astype(np.int64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ScanError(f"faces use vertices {faces.min()} to {faces.max()}, there are 0 to {len(vertices) - 1}; "
                        "repair the mesh")
    extent = np.ptp(vertices[faces.ravel()], axis=0).max()
    if not (np.linalg.norm(_face_normals(vertices, faces), axis=1) > 1e-14 * extent**2).any():
        raise ScanError(f"none of the {len(faces)} faces has an area; repair the mesh")
    return faces


def _face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Normals (M, 3), as long as twice the triangle's area."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def _merge_vertices(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same triangles over vertices of which no two are at the same place."""
    places, which = np.unique(vertices, axis=0, return_inverse=True)
    return places, which.reshape(-1)[faces]


def _edge_angles(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle in radians and length (E,) of each edge between exactly two faces with an area; winding does not matter."""
    normals = _face_normals(vertices, faces)
    size = np.linalg.norm(normals, axis=1)
    solid = size > 0
    faces, normals = faces[solid], normals[solid] / size[solid, None]
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ahead = np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0)
    keys = np.sort(edges, axis=1) @ np.array([len(vertices), 1])
    order = np.argsort(keys, kind="stable")
    _, first, count = np.unique(keys[order], return_index=True, return_counts=True)
    one, other = order[first[count == 2]], order[first[count == 2] + 1]
    facing = -ahead[one] * ahead[other]  # neighbours wound alike walk their shared edge in opposite directions
    cosine = facing * (normals[one // 3] * normals[other // 3]).sum(axis=1)
    length = np.linalg.norm(vertices[edges[one, 0]] - vertices[edges[one, 1]], axis=1)
    return np.arccos(np.clip(cosine, -1.0, 1.0)), length
