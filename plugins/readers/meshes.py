"""Vertices of STL, GLB and glTF files, without duplicates."""

from __future__ import annotations

import io
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.interfaces import MEMORY_A_BYTE, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.gltf import readable_glb
from z2p_renderer.plugins.readers._helpers.gltf_fields import PartFields, field_names_of, read_part_fields
from z2p_renderer.plugins.readers._helpers.gltf_parts import as_glb, bytes_beside
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily
from z2p_renderer.plugins.readers._helpers.length_check import check_trailing_bytes, trailing_bytes_note
from z2p_renderer.plugins.readers._helpers.point_fields import Wants, plain_column

_STL_HEADER_BYTES, _STL_TRIANGLE_BYTES = 84, 50
"""Size of the header of a binary STL file, and of each triangle."""


class Meshes(Reader):
    """STL and glTF, in one file or several (trimesh).

    Only the vertices count, so a mesh of few large triangles makes a thin cloud.
    """

    name = "meshes"
    version = "5"
    takes_columns = False
    packages = ("trimesh",)
    suffixes = (".stl", ".glb", ".gltf")

    def memory(self, path: Path) -> int:
        """A glTF file's points may all be in files beside it."""
        beside = bytes_beside(path) if path.suffix.lower() == ".gltf" else 0
        return MEMORY_A_BYTE * (path.stat().st_size + beside)

    def read(self, path: Path) -> list[RawCloud]:
        """The file's vertices, one cloud (N, 3) float64; parts of a GLB scene stand where the scene puts them.

        Both formats repeat a vertex for each triangle or seam; those at one place become one.

        Raises:
            ScanError: no file of its format, one of another length than it promises, or without triangles.
        """
        try:
            if path.suffix.lower() == ".stl":
                points, note = _read_stl(path.read_bytes())
                cloud = RawCloud(points, note=note)
            else:
                cloud = _read_glb(as_glb(path) if path.suffix.lower() == ".gltf" else path.read_bytes(), self.wants)
        except (ScanError, ImportError):  # no fault of the file
            raise
        except Exception as error:  # the library raises errors of any type on damaged files
            raise ScanError(f"the vertices cannot be read ({error_reason(error)}); export the file again") from error
        first = np.sort(np.unique(cloud.points, axis=0, return_index=True)[1])
        fields = {name: values[first] for name, values in cloud.fields.items()}
        return [replace(cloud, points=cloud.points[first], fields=fields)]


def _read_stl(blob: bytes) -> tuple[np.ndarray, str]:
    """Corners of the triangles (N, 3) float64, and a note."""
    note = ""
    if _is_text(blob):
        loaded = import_lazily("trimesh.exchange.stl").load_stl_ascii(io.BytesIO(_check_complete(blob)))
    else:
        if len(blob) < _STL_HEADER_BYTES:
            raise ScanError(f"a binary STL file begins with {_STL_HEADER_BYTES} bytes of header, got {len(blob)} in "
                            "all; it is cut short, or another format: export it again")
        (count,) = struct.unpack_from("<I", blob, _STL_HEADER_BYTES - 4)
        size = _STL_TRIANGLE_BYTES * count
        promise = f"the STL header promises {count} triangles"
        note = trailing_bytes_note(check_trailing_bytes(promise, size, len(blob) - _STL_HEADER_BYTES))
        loaded = import_lazily("trimesh.exchange.stl").load_stl_binary(io.BytesIO(blob[: _STL_HEADER_BYTES + size]))
    solids = loaded["geometry"].values() if "geometry" in loaded else [loaded]
    parts = [np.asarray(solid["vertices"], dtype=np.float64).reshape(-1, 3) for solid in solids]
    if not parts:
        raise ScanError("the STL file holds no triangle, so no points; export the mesh again")
    return np.concatenate(parts), note


def _is_text(blob: bytes) -> bool:
    """Whether an STL file is text; the header of a binary one may begin with the same word."""
    head = blob[:4096].lower()
    return head.lstrip().startswith(b"solid") and (b"vertex" in head or b"endsolid" in head)


def _check_complete(blob: bytes) -> bytes:
    """Returns the text of an STL file after a check that it is complete.

    Raises:
        ScanError: its last solid has no end, so the library would ignore it.
    """
    lower = blob.lower()
    if lower.rfind(b"vertex") > lower.rfind(b"endsolid"):
        raise ScanError("the STL file is cut short: its last solid has no 'endsolid'; export it again")
    return blob


def _read_glb(blob: bytes, wants: Wants) -> RawCloud:
    """Vertices (N, 3) float64 of a scene, with their fields."""
    if blob[:4] != b"glTF":
        raise ScanError("expected a GLB file, which begins with 'glTF'; this is another format under that name")
    blob = readable_glb(blob)
    load = import_lazily("trimesh").load_scene
    scene = load(io.BytesIO(blob), file_type="glb", process=False, skip_materials=not wants("rgb"))
    parts = read_part_fields(blob)
    counts = [len(geometry.vertices) for geometry in scene.geometry.values()]
    if counts != [part.count for part in parts]:  # the library left some out
        parts = [PartFields(count) for count in counts]
    part_of = dict(zip(scene.geometry, parts, strict=True))
    textures = {name: _texture_colors(scene.geometry[name]) for name in scene.geometry} if wants("rgb") else {}
    names = field_names_of(parts, any(colors is not None for colors in textures.values()))
    points = [np.empty((0, 3))]
    fields: dict[str, list[np.ndarray]] = {name: [] for name in names if wants(name)}
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        vertices = np.asarray(scene.geometry[name].vertices, dtype=np.float64)
        points.append(vertices @ transform[:3, :3].T + transform[:3, 3])
        for field, values in fields.items():
            values.append(_part_values(part_of[name], field, transform, textures.get(name)))
    columns = {field: plain_column(np.concatenate(values)) for field, values in fields.items() if values}
    kinds = dict.fromkeys(part.color_kind for part in parts if part.color_kind)
    return RawCloud(np.concatenate(points), fields=columns, field_names=tuple(names),
                    color_kind=", ".join(kinds) if "rgb" in columns else "")


def _part_values(
    part: PartFields, name: str, transform: np.ndarray, texture: np.ndarray | None
) -> np.ndarray:
    """The values of a field at the vertices of one part of a scene; NaN where it does not have the field."""
    if name == "rgb":
        return part.srgb(texture)
    if name == "normal":
        if part.normals is None:
            return np.full((part.count, 3), np.nan)
        return np.asarray(part.normals @ np.linalg.inv(transform[:3, :3]), dtype=np.float32)
    return part.scalars.get(name, np.full(part.count, np.nan))


def _texture_colors(geometry: Any) -> np.ndarray | None:
    """sRGB colors (N, 3) in [0, 1] of a mesh's picture at its vertices; None if it has no picture."""
    visual: Any = getattr(geometry, "visual", None)
    picture = getattr(getattr(visual, "material", None), "baseColorTexture", None)
    uv = getattr(visual, "uv", None)
    if picture is None or uv is None or len(uv) != len(geometry.vertices):
        return None
    return np.asarray(visual.material.to_color(uv), dtype=np.float32)[:, :3] / np.float32(255)
