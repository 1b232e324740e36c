"""Measures how much turntables flicker, against Blender renders of the same rotation.

    python scripts/measure_flicker.py [--mesh FILE] [--frames 12] [--step 5] [--resolution 256]

Needs the pipeline extra. Prints the mean error of the change from frame to frame on the object, of 255, for several
ways to draw the frames; 0 means that the frames change exactly as the rendered ones do.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from z2p_core.camera import turn
from z2p_core.images import bytes_from_unit, premultiplied_from_straight, straight_from_premultiplied, unit_from_bytes
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.quality.flicker import flicker
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import render_scan
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.render import RenderSettings, export_suzanne, read_render, render_mesh
from z2p_renderer.storage.meshes import Mesh, is_smooth_surface, read_mesh
from z2p_renderer.storage.scans.clouds import usable

LIGHT = (3.6, -40.0, 50.0)
GRAY_BLUE = (0.29, 0.53, 0.73)


def main() -> None:
    """Renders the rotation, draws it by each method, and prints the metrics."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, help="a mesh file; Blender's monkey without it")
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--step", type=float, default=5.0, help="degrees from frame to frame")
    parser.add_argument("--resolution", type=int, default=256)
    parser.add_argument("--points", type=int, default=5000)
    parser.add_argument("--samples", type=int, default=32)
    options = parser.parse_args()
    mesh = _mesh(options.mesh)
    with tempfile.TemporaryDirectory() as folder:
        truth, mask = _truth(mesh, options, Path(folder))
    cloud = _cloud(mesh, options.points)
    renderer = Renderer("regular")
    print(f"{'method':<28}{'flicker':>9}{'error':>9}")
    print(f"{'standing still':<28}{flicker(np.repeat(truth[:1], len(truth), 0), truth, mask):9.2f}{'-':>9}")
    for steady in (1, 2, 3, 5):
        for supersample in (1, 2):
            frames = np.stack([_frame(renderer, cloud, options, number, steady, supersample)
                               for number in range(options.frames)])  # fmt: skip
            error = np.abs(frames[..., :3].astype(float) - truth[..., :3])[mask].mean()
            name = f"mean of {steady}, supersample {supersample}"
            print(f"{name:<28}{flicker(frames, truth, mask):9.2f}{error:9.2f}", flush=True)


def _mesh(path: Path | None) -> Mesh:
    if path is not None:
        mesh = read_mesh(path)
        vertices, faces = mesh.vertices, mesh.faces
    else:
        import trimesh

        with tempfile.TemporaryDirectory() as folder:
            export_suzanne(Path(folder) / "suzanne.npz")
            with np.load(Path(folder) / "suzanne.npz") as arrays:
                vertices, faces = trimesh.remesh.subdivide_loop(arrays["vertices"].astype(float), arrays["faces"], 2)
    return Mesh(bounding_sphere(vertices).normalise(vertices), faces, is_smooth_surface(vertices, faces))


def _truth(mesh: Mesh, options: argparse.Namespace, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Blender's frames (T, H, W, 4) uint8 and the object's mask (T, H, W)."""
    from z2p_core.images import linear_from_srgb

    red, green, blue = (float(linear_from_srgb(channel)) for channel in GRAY_BLUE)
    scenes = []
    for number in range(options.frames):
        rotation = tuple(tuple(row) for row in turn(options.step * number).tolist())
        material = {"Base Color": (red, green, blue, 1.0)}
        scenes.append((f"{number:03d}", SceneDescription(20.0, LIGHT, material, rotation)))
    side = options.resolution
    render_mesh(mesh, scenes, folder, RenderSettings((side, side), options.samples, "high"))
    frames = np.stack([bytes_from_unit(read_render(folder / f"{stem}.png", (side, side, 4))) for stem, _ in scenes])
    coverage = np.stack([read_render(folder / f"{stem}.coverage.png", (side, side)) for stem, _ in scenes])
    return frames, coverage > 0.9


def _cloud(mesh: Mesh, count: int) -> np.ndarray:
    import trimesh

    points, _ = trimesh.sample.sample_surface(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False), count, seed=0)
    return np.asarray(points, dtype=np.float64)


def _frame(
    renderer: Renderer, cloud: np.ndarray, options: argparse.Namespace, number: int, steady: int, supersample: int
) -> np.ndarray:
    shots = []
    for part in range(steady):
        angle = options.step * (number + (part + 0.5) / steady - 0.5)
        rotation = tuple(tuple(row) for row in turn(angle).tolist())
        placing = PlacementOptions(keep_outliers=True, viewpoint=Viewpoint((0.0, 0.0, 0.0), 1.0, rotation, 20.0))
        look = replace(Look({"color": GRAY_BLUE, "light": LIGHT}, placing), width=options.resolution,
                       height=options.resolution, supersample=supersample)  # fmt: skip
        shots.append(
            premultiplied_from_straight(unit_from_bytes(render_scan(renderer, usable(cloud), "", look).picture))
        )
    return bytes_from_unit(straight_from_premultiplied(np.mean(shots, axis=0)))


if __name__ == "__main__":
    main()
