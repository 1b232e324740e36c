"""Blender's renders of meshes with colors of their own: the same light and shape, other paint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.render import RenderSettings, read_render, render_mesh
from z2p_renderer.pipeline.rendering.textured_meshes import render_textured_mesh
from z2p_renderer.pipeline.rendering.textures import SeededTexture
from z2p_renderer.pipeline.shapes import shape
from z2p_renderer.storage.meshes import Mesh

SIDE = 64
SETTINGS = RenderSettings((SIDE, SIDE), samples=16, denoise="off", threads=1)
UNIFORM = SeededTexture("uniform", (5,))


def coarse_mesh(smooth: bool) -> Mesh:
    """The vase with so few triangles that its shading normals matter."""
    vertices, faces = shape("vase")
    center = (vertices.max(axis=0) + vertices.min(axis=0)) / 2
    vertices = (vertices - center) / np.linalg.norm(vertices - center, axis=1).max()
    return Mesh(vertices, faces, smooth)


def picture(folder: Path, stem: str = "view") -> np.ndarray:
    return read_render(folder / f"{stem}.png", (SIDE, SIDE, 4))


@pytest.mark.slow
@pytest.mark.parametrize("smooth", [True, False])
def test_a_uniform_texture_is_a_base_color(tmp_path: Path, smooth: bool) -> None:
    mesh, scene = coarse_mesh(smooth), SceneDescription()
    render_textured_mesh(mesh, UNIFORM, [("view", scene)], tmp_path / "textured", SETTINGS)
    scene.material["Base Color"] = (*UNIFORM.albedo(np.zeros((1, 3)))[0].tolist(), 1.0)
    render_mesh(mesh, [("view", scene)], tmp_path / "plain", SETTINGS)
    difference = np.abs(picture(tmp_path / "textured") - picture(tmp_path / "plain"))
    assert difference.mean() < 0.002 and np.quantile(difference, 0.99) < 0.02


@pytest.mark.slow
def test_colors_lie_where_the_texture_has_them(tmp_path: Path) -> None:
    """Vertex colors and a texture alike: the upper half in one color, the lower half in another."""
    mesh = coarse_mesh(smooth=True)
    colors = np.where(mesh.vertices[:, 2:] > 0, (0.6, 0.05, 0.05), (0.05, 0.05, 0.6))
    render_textured_mesh(mesh, colors, [("view", SceneDescription())], tmp_path, SETTINGS)
    shown = picture(tmp_path)
    inside = read_render(tmp_path / "view.coverage.png", (SIDE, SIDE)) > 0.99
    redder, upper = shown[..., 0] > shown[..., 2], np.indices((SIDE, SIDE))[0] < 22
    lower = np.indices((SIDE, SIDE))[0] > 44
    assert redder[inside & upper].mean() > 0.95 and redder[inside & lower].mean() < 0.05


@pytest.mark.slow
def test_pictures_that_are_there_are_left_alone(tmp_path: Path) -> None:
    mesh, scene = coarse_mesh(smooth=True), SceneDescription()
    render_textured_mesh(mesh, UNIFORM, [("view", scene)], tmp_path, SETTINGS)
    written = (tmp_path / "view.png").stat().st_mtime_ns
    render_textured_mesh(mesh, UNIFORM, [("view", scene), ("other", scene)], tmp_path, SETTINGS)
    assert (tmp_path / "view.png").stat().st_mtime_ns == written and (tmp_path / "other.png").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "other.coverage.png", "other.png", "view.coverage.png", "view.png"]  # fmt: skip
