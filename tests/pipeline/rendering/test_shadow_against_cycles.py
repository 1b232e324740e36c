"""The rough rendering's shadow against Cycles' own: the same scene, once as a mesh and once as bare points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.render import RenderSettings, read_render, render_mesh
from z2p_renderer.storage.meshes import Mesh

SIDE = 64


@pytest.mark.slow
@pytest.mark.parametrize("elevation", [15.0, 50.0])
def test_the_floors_shadow_is_that_of_the_render(tmp_path: Path, elevation: float) -> None:
    """A black ball, and a bright one that lights its own shadow; where floor is seen at all."""
    pytest.importorskip("bpy")
    ball = trimesh.creation.icosphere(4)
    light = (3.75, -40.0, 50.0)
    scenes = {name: SceneDescription(elevation, light, {"Base Color": color}) for name, color in
              {"black": (0.0, 0.0, 0.0, 1.0), "orange": (0.9, 0.4, 0.1, 1.0)}.items()}  # fmt: skip
    settings = RenderSettings((SIDE, SIDE), samples=128, denoise="off")
    render_mesh(Mesh(ball.vertices, ball.faces, smooth=True), list(scenes.items()), tmp_path, settings)
    points = np.random.default_rng(0).normal(size=(20_000, 3)).astype(np.float32)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    for name, scene in scenes.items():
        truth = read_render(tmp_path / f"{name}.png", (SIDE, SIDE, 4))[..., 3]
        floor = read_render(tmp_path / f"{name}.coverage.png", (SIDE, SIDE)) == 0
        shadow = registry.load("gbuffers", "surfels")().draw(points, Camera(SIDE, SIDE, elevation), scene)[-1]
        off = (shadow - truth)[floor & (truth > 0.03)]
        assert abs(off.mean()) < 0.01 and np.abs(off).mean() < 0.0125, name
