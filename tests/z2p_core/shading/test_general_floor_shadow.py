"""The floor's shadow for any camera: that of the kernel where both can draw it."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.native.lighting import Floor
from z2p_core.pinhole import aimed_camera
from z2p_core.placement.placed_camera import PlacedCamera, place_camera
from z2p_core.placement.usual_camera import usual_pinhole
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.shading.general_floor_shadow import draw_general_floor_shadow

UPRIGHT = Viewpoint((0.0, 0.0, 0.0), 1.0, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), 20.0)
FLOOR = Floor(
    -0.7, 4.0, np.array([[-2.0, -2, 3], [-1.8, -2.2, 3], [-2, -2.2, 3], [-1.8, -2, 3]]), np.array([0.5, 0.5, -0.7071]),
    40.0, 0.35, 0.8,
)  # fmt: skip


def grids() -> list[np.ndarray]:
    """Smooth occlusion of light, sky and reflection, and the cloud's radiance, around the floor's middle."""
    found = []
    for side, height in ((64, 0.9), (64, 0.5), (32, 0.4), (16, 0.1)):
        y, x = np.mgrid[:side, :side] / side - 0.5
        found.append((height * np.exp(-40 * (x**2 + (y - 0.05) ** 2))).astype(np.float32))
    return found


def general(camera: PlacedCamera) -> np.ndarray:
    out = np.empty((camera.height, camera.width), np.float32)
    draw_general_floor_shadow(*grids(), FLOOR, camera, out)
    return out


@pytest.mark.parametrize("elevation", [5.0, 30.0, 70.0])
def test_the_usual_camera_sees_the_kernels_shadow(elevation: float) -> None:
    expected = np.empty((100, 140), np.float32)
    native.floor_shadow(*grids(), FLOOR, Camera(140, 100, elevation), expected)
    drawn = general(place_camera(usual_pinhole(UPRIGHT, 140, 100, elevation), UPRIGHT))
    assert expected.max() > 0.3
    np.testing.assert_allclose(drawn, expected, atol=0.01)


def test_from_below_there_is_no_shadow() -> None:
    camera = aimed_camera(np.array([2.0, -2, -3]), np.zeros(3), np.array([0, 0, 1.0]), (64, 64), 60, None)
    assert not general(place_camera(camera, UPRIGHT)).any()


def test_parallel_rays_see_the_shadow_to_scale() -> None:
    camera = aimed_camera(np.array([0.0, 0, 5]), np.zeros(3), np.array([0, 0, 1.0]), (160, 160), 40, 20.0)
    drawn = general(place_camera(camera, UPRIGHT))
    row, column = np.unravel_index(int(drawn.argmax()), drawn.shape)
    assert column == pytest.approx(80, abs=4) and row == pytest.approx(80 - 20 * 0.05 * 8, abs=4)
