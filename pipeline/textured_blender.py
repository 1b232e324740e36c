"""The Blender child process for meshes with colors of their own, in place of the material's base color.

Started by `pipeline.rendering.textured_meshes` as ``python -m z2p_renderer.pipeline.textured_blender JOB``. JOB is a
folder as `pipeline.blender` takes it; either its ``mesh.npz`` has ``albedo``, linear colors (V, 3) of the vertices, or
its ``job.json`` names a ``texture``. It is a module of its own so that other renders do not depend on its code.
"""

from __future__ import annotations

import json
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.meshes.subdivision import subdivide, subdivision_steps
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline import blender
from z2p_renderer.pipeline.rendering.textures import SeededTexture

ALBEDO = "albedo"
"""Name of the attribute with a mesh's colors. Blender takes one of floats to be linear, and one of bytes to be sRGB."""
NORMAL = "custom_normal"
"""Name under which Blender takes an attribute to be a mesh's shading normals."""


def main(job_folder: Path) -> None:
    """Render every scene of the job, in order."""
    job = json.loads((job_folder / "job.json").read_text())
    blender.bpy.ops.wm.read_factory_settings(use_empty=True)
    with np.load(job_folder / "mesh.npz") as arrays:
        mesh = blender.make_mesh(arrays["vertices"], arrays["faces"], bool(arrays["smooth"]))
        albedo = arrays.get(ALBEDO)
    scene = blender.BlenderScene(mesh, job["settings"])
    if albedo is not None:
        set_albedo(mesh, albedo)
    else:
        texture = SeededTexture.from_json(job["texture"])
        scene.object.data = mesh = subdivided(mesh, job["max_edge"])
        set_albedo(mesh, texture.albedo(_get(mesh.vertices, "co", np.float32).reshape(-1, 3)))
    link_base_color(scene.surface)
    for stem, description in job["scenes"]:
        started = time.perf_counter()
        scene.pose(SceneDescription.from_json(description))
        scene.render(job_folder / f"{stem}.exr", zlib.crc32(f"{job['settings']['seed']} {stem}".encode()) >> 1)
        print(f"done {stem} {time.perf_counter() - started:.3f}", flush=True)


def subdivided(mesh: Any, max_edge: float) -> Any:
    """A mesh of triangles with the same surface, shading normals and materials, whose edges are short.

    Three vertices belong to each triangle alone. Edges are up to `max_edge` long, see `subdivision_steps`.
    """
    positions = _get(mesh.vertices, "co", np.float32).reshape(-1, 3)
    corners = positions[_get(mesh.loops, "vertex_index", np.int32)].reshape(-1, 3, 3)
    normals = _get(mesh.corner_normals, "vector", np.float32).reshape(-1, 3, 3)
    finer = subdivide(np.concatenate([corners, normals], axis=2), subdivision_steps(corners, max_edge)).reshape(-1, 6)
    count = len(finer)
    result = mesh.copy()
    result.clear_geometry()
    result.vertices.add(count)
    result.vertices.foreach_set("co", finer[:, :3].ravel())
    result.loops.add(count)
    result.loops.foreach_set("vertex_index", np.arange(count, dtype=np.int32))
    result.polygons.add(count // 3)
    result.polygons.foreach_set("loop_start", np.arange(0, count, 3, dtype=np.int32))
    result.update(calc_edges=True)
    unit = finer[:, 3:] / np.maximum(np.linalg.norm(finer[:, 3:], axis=1, keepdims=True), 1e-12)
    result.attributes.new(NORMAL, "FLOAT_VECTOR", "CORNER").data.foreach_set("vector", unit.ravel())
    return result


def set_albedo(mesh: Any, albedo: np.ndarray) -> None:
    """Give a mesh linear colors (V, 3) of its vertices."""
    attribute = mesh.color_attributes.new(ALBEDO, "FLOAT_COLOR", "POINT")
    attribute.data.foreach_set("color", np.column_stack([albedo, np.ones(len(albedo))]).astype(np.float32).ravel())


def link_base_color(surface: Any) -> None:
    """Make the vertices' colors the base color of a Principled BSDF, whatever value its input has."""
    tree = surface.id_data
    colors = tree.nodes.new("ShaderNodeVertexColor")
    colors.layer_name = ALBEDO
    tree.links.new(colors.outputs["Color"], surface.inputs["Base Color"])


def _get(collection: Any, attribute: str, dtype: type) -> np.ndarray:
    """The attribute's numbers of all items, flat."""
    width = len(np.atleast_1d(getattr(collection[0], attribute)))
    numbers: np.ndarray = np.empty(width * len(collection), dtype)
    collection.foreach_get(attribute, numbers)
    return numbers


if __name__ == "__main__":
    main(Path(sys.argv[1]))
