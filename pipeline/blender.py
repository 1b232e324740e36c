"""The Blender child process: the only file that imports bpy (GPL), so nothing else of z2p ever does.

Started by `pipeline.render` as ``python -m z2p_renderer.pipeline.blender JOB``. JOB is a folder with ``job.json`` and
``mesh.npz``. Each picture is written into it as a multi-layer OpenEXR file of scene-linear float values; a line
``done STEM SECONDS`` is printed when it is complete. `z2p_core.scene` and `z2p_core.camera` define the scene.
"""

from __future__ import annotations

import json
import math
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from z2p_core.camera import DISTANCE, FIELD_OF_VIEW, light_position
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription

FLOOR_SIDE = 60.0
"""Side of the square floor, world units."""
FLOOR_GAP = 1e-3
"""Gap between floor and lowest point, world units; a flat sheet that coincides with the floor would render black."""
SHARP_ANGLE = math.radians(40)
"""Smooth-shaded meshes keep edges sharper than this, so that CAD models stay crisp."""
DENOISER_SETTINGS = {"fast": ("FAST", "FAST"), "balanced": ("BALANCED", "ACCURATE"), "high": ("HIGH", "ACCURATE")}
"""Setting -> Open Image Denoise's quality, and the prefiltering of the albedo and normals that guide it.

Accurate prefiltering doubles the time, and only mirror reflections improve.
"""
DIFFUSE_INPUTS = {"Roughness": 1.0, "Metallic": 0.0, "Specular IOR Level": 0.0}
"""Inputs of the Principled BSDF that make it purely diffuse, as in the paper."""


def main(job_folder: Path) -> None:
    """Render every scene of the job, in order."""
    job = json.loads((job_folder / "job.json").read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if "suzanne" in job:
        export_suzanne(Path(job["suzanne"]))
        return
    with np.load(job_folder / "mesh.npz") as arrays:
        mesh = make_mesh(arrays["vertices"], arrays["faces"], bool(arrays["smooth"]))
    scene = BlenderScene(mesh, job["settings"])
    for stem, description in job["scenes"]:
        started = time.perf_counter()
        scene.pose(SceneDescription.from_json(description))
        scene.render(job_folder / f"{stem}.exr", zlib.crc32(f"{job['settings']['seed']} {stem}".encode()) >> 1)
        print(f"done {stem} {time.perf_counter() - started:.3f}", flush=True)


def make_mesh(vertices: np.ndarray, faces: np.ndarray, smooth: bool) -> Any:
    """Blender mesh of float vertices (V, 3) and triangles (M, 3); validated, as an index out of range would crash."""
    mesh = bpy.data.meshes.new("object")
    mesh.vertices.add(len(vertices))
    mesh.loops.add(3 * len(faces))
    mesh.polygons.add(len(faces))
    # arrays, where from_pydata takes lists: a tenth of the time and memory for millions of triangles
    mesh.vertices.foreach_set("co", np.ascontiguousarray(vertices, np.float32).ravel())
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(faces), 3, dtype=np.int32))
    mesh.polygons.foreach_set("vertices", np.ascontiguousarray(faces, np.int32).ravel())
    if not smooth:
        mesh.shade_flat()
    mesh.update(calc_edges=True)
    mesh.validate()
    mesh.update()
    if smooth:
        mesh.set_sharp_from_angle(angle=SHARP_ANGLE)
    return mesh


def vertex_positions(mesh: Any) -> np.ndarray:
    """Positions (V, 3) float64 of a mesh's vertices."""
    positions = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", positions)
    return positions.reshape(-1, 3).astype(np.float64)


class BlenderScene:
    """The paper's scene (section 3.2): object, shadow-catching floor, square area light, ambient light, camera."""

    def __init__(self, mesh: Any, settings: dict[str, Any]) -> None:
        self.scene = bpy.context.scene
        self.vertices = vertex_positions(mesh)
        self.object = self._add("object", mesh)
        self.surface = self._add_material(mesh)
        self.default_inputs: dict[str, Any] = {}  # Blender's values of the inputs that some scene has set
        self.floor = self._add_floor()
        self.light = self._add_light()
        self.camera = self._add("camera", bpy.data.cameras.new("camera"))
        self.scene.camera = self.camera
        self._add_world()
        self._configure(settings)

    def pose(self, description: SceneDescription) -> None:
        """Sets object, floor, light, camera and material as the description says."""
        rotation = np.array(description.rotation)
        lowest = float((self.vertices @ rotation[2]).min()) if description.floor is None else description.floor
        self.object.matrix_world = Matrix.Translation((0, 0, description.lift)) @ Matrix(rotation.tolist()).to_4x4()
        self.floor.location = (0, 0, lowest - FLOOR_GAP)
        _look_at_origin(self.light, Vector(light_position(description.light)))
        elevation = math.radians(description.elevation)
        _look_at_origin(self.camera, DISTANCE * Vector((0, -math.cos(elevation), math.sin(elevation))))
        for name, value in {**self.default_inputs, **DIFFUSE_INPUTS, **description.material}.items():
            if name not in self.surface.inputs:
                raise SystemExit(f"the Principled BSDF of Blender {bpy.app.version_string} has no input {name!r}")
            field = self.surface.inputs[name]
            self.default_inputs.setdefault(name, _copied_value(field.default_value))
            field.default_value = value

    def render(self, path: Path, seed: int) -> None:
        """Renders and writes all passes as a multi-layer OpenEXR file; `seed` is that of Cycles' noise."""
        self.scene.cycles.seed = seed
        self.scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True)

    def _add(self, name: str, data: Any) -> Any:
        item = bpy.data.objects.new(name, data)
        self.scene.collection.objects.link(item)
        return item

    def _add_material(self, mesh: Any) -> Any:
        material = bpy.data.materials.new("surface")
        nodes = material.node_tree.nodes
        surface = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
        coverage = nodes.new("ShaderNodeOutputAOV")  # 1 on the object, 0 on floor and shadow
        coverage.aov_name = "coverage"
        coverage.inputs["Value"].default_value = 1.0
        mesh.materials.append(material)
        return surface

    def _add_floor(self) -> Any:
        half = FLOOR_SIDE / 2
        plane = bpy.data.meshes.new("floor")
        plane.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
        floor = self._add("floor", plane)
        floor.is_shadow_catcher = True
        return floor

    def _add_light(self) -> Any:
        area_light = bpy.data.lights.new("light", "AREA")
        area_light.shape, area_light.size = "SQUARE", LIGHT_SIDE
        area_light.energy = LIGHT_RADIANCE * LIGHT_SIDE**2 * math.pi  # watts of a one-sided emitter of that radiance
        light = self._add("light", area_light)
        light.visible_camera = False
        return light

    def _add_world(self) -> None:
        world = bpy.data.worlds.new("world")
        background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
        background.inputs["Color"].default_value = (AMBIENT, AMBIENT, AMBIENT, 1.0)
        self.scene.world = world

    def _configure(self, settings: dict[str, Any]) -> None:
        render, cycles = self.scene.render, self.scene.cycles
        render.engine = "CYCLES"
        cycles.device = "CPU"
        cycles.samples = settings["samples"]
        cycles.max_bounces = settings["bounces"]
        cycles.use_adaptive_sampling = False
        cycles.use_light_tree = False  # useless with one light and a constant sky, and a seventh slower
        cycles.use_denoising = settings["denoise"] != "off"
        if cycles.use_denoising:
            cycles.denoiser = "OPENIMAGEDENOISE"
            cycles.denoising_quality, cycles.denoising_prefilter = DENOISER_SETTINGS[settings["denoise"]]
            cycles.denoising_use_gpu = False
        width, height = settings["resolution"]
        render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
        render.film_transparent = True
        render.use_persistent_data = True
        if settings["threads"]:
            render.threads_mode, render.threads = "FIXED", settings["threads"]
        render.image_settings.media_type = "MULTI_LAYER_IMAGE"
        render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
        render.image_settings.color_depth = "32"
        render.image_settings.exr_codec = "NONE"
        camera = self.camera.data
        camera.sensor_fit = "VERTICAL" if width >= height else "HORIZONTAL"
        camera.angle = math.radians(FIELD_OF_VIEW)
        camera.clip_start, camera.clip_end = 0.1, 2 * FLOOR_SIDE
        layer = self.scene.view_layers[0]
        aov = layer.aovs.add()
        aov.name, aov.type = "coverage", "VALUE"
        layer.use_pass_z = "depth" in settings["passes"]
        layer.use_pass_normal = "normal" in settings["passes"]
        layer.cycles.use_pass_shadow_catcher = "shadow" in settings["passes"]


def export_suzanne(path: Path) -> None:
    """Write Blender's monkey, subdivided once, as vertices and triangles of an npz."""
    bpy.ops.mesh.primitive_monkey_add()
    monkey = bpy.context.object
    monkey.modifiers.new("smooth", "SUBSURF").render_levels = 1
    monkey.modifiers["smooth"].levels = 1
    mesh = monkey.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    mesh.calc_loop_triangles()
    vertices = np.array([vertex.co for vertex in mesh.vertices])
    faces = np.array([triangle.vertices for triangle in mesh.loop_triangles])
    np.savez(path, vertices=vertices, faces=faces)


def _copied_value(value: Any) -> Any:
    """A copy of an input's value; Blender's own object changes with later assignments."""
    return value if isinstance(value, (int, float)) else tuple(value)


def _look_at_origin(item: Any, position: Vector) -> None:
    """Places a light or camera at `position`, looking at the origin with +Z up; both look along their -Z in Blender."""
    item.location = position
    item.rotation_mode = "QUATERNION"
    item.rotation_quaternion = (-position).to_track_quat("-Z", "Y")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
