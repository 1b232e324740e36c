"""The scene that light falls on."""

import numpy as np
import pytest

from z2p_core.scene import SceneDescription
from z2p_core.shading.light_transport import IRRADIANCE_CELLS, LightScene


def _scene(spacing: float) -> LightScene:
    point = np.zeros((1, 3), np.float32)
    return LightScene.create(point, point + np.float32([0, 0, 1]), spacing, SceneDescription(), -1.0)


def test_light_on_the_floor_is_as_fine_as_the_points_allow() -> None:
    cells = [_scene(spacing).irradiance_cells for spacing in (0.2, 0.04, 0.02, 0.01, 0.001)]
    assert cells == sorted(cells)
    assert (cells[0], cells[-1]) == IRRADIANCE_CELLS


@pytest.mark.parametrize("spacing", [0.02, 0.025])
def test_cells_that_receive_light_are_wider_than_the_points_lie_apart(spacing: float) -> None:
    scene = _scene(spacing)
    assert 2 * scene.floor.half_size / scene.irradiance_cells > 2 * spacing
