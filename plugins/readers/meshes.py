"""Vertices of STL, GLB and glTF files, without duplicates."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.interfaces import MEMORY_A_BYTE, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.color_note import IGNORED_NOTE
from z2p_renderer.plugins.readers._helpers.gltf import readable_glb
from z2p_renderer.plugins.readers._helpers.gltf_parts import as_glb, bytes_beside
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily
from z2p_renderer.plugins.readers._helpers.length_check import check_trailing_bytes, trailing_bytes_note

_STL_HEADER_BYTES, _STL_TRIANGLE_BYTES = 84, 50
"""Size of the header of a binary STL file, and of each triangle."""


class Meshes(Reader):
    """STL and glTF, in one file or several (trimesh).

    Only the vertices count, so a mesh of few large triangles makes a thin cloud.
    """

    name = "meshes"
    version = "4"
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
            match path.suffix.lower():
                case ".stl":
                    points, note = _read_stl(path.read_bytes())
                case ".gltf":
                    points, note = _read_glb(as_glb(path))
                case _:
                    points, note = _read_glb(path.read_bytes())
        except (ScanError, ImportError):  # no fault of the file
            raise
        except Exception as error:  # the library raises errors of any type on damaged files
            raise ScanError(f"the vertices cannot be read ({error_reason(error)}); export the file again") from error
        first = np.unique(points, axis=0, return_index=True)[1]
        return [RawCloud(points[np.sort(first)], note=note)]


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


def _read_glb(blob: bytes) -> tuple[np.ndarray, str]:
    """Vertices (N, 3) float64 of a scene, and a note."""
    if blob[:4] != b"glTF":
        raise ScanError("expected a GLB file, which begins with 'glTF'; this is another format under that name")
    scene = import_lazily("trimesh").load_scene(io.BytesIO(readable_glb(blob)), file_type="glb", process=False)
    parts = [np.empty((0, 3))]
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        vertices = np.asarray(scene.geometry[name].vertices, dtype=np.float64)
        parts.append(vertices @ transform[:3, :3].T + transform[:3, 3])
    colored = b'"COLOR_0"' in blob[: 20 + int.from_bytes(blob[12:16], "little")]
    return np.concatenate(parts), IGNORED_NOTE if colored else ""
