"""Light from the cloud to the floor."""

import numpy as np
import pytest

from z2p_core import native
from z2p_core.scene import SceneDescription
from z2p_core.shading import light_transport
from z2p_core.shading.light_transport import LightScene, Quality, begin_floor_visibility, sending_to_floor


def test_every_nth_point_lights_the_floor_as_all_points_do(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (4000, 2)), np.full(4000, 0.5)]).astype(np.float32)
    normals = np.tile(np.float32([0, 0, 1]), (4000, 1))
    scene = LightScene.create(points, normals, 0.03, SceneDescription(), -0.5)
    sent = np.ones((2, 4000), np.float32)

    def irradiance() -> np.ndarray:
        seen = begin_floor_visibility(scene, Quality(floor_directions=16)).result()
        return native.floor_irradiance(sending_to_floor(sent), seen, scene.irradiance_cells)

    with_all = irradiance()
    monkeypatch.setattr(light_transport, "MAX_FLOOR_LIGHT_POINTS", 2000)
    with_half = irradiance()
    assert begin_floor_visibility(scene, Quality()).result().shape[2] == 2000
    assert abs(with_half.sum() / with_all.sum() - 1) < 0.2


def test_which_points_light_the_floor_does_not_change_what_they_send() -> None:
    count = 3 * light_transport.MAX_FLOOR_LIGHT_POINTS - 1
    sides = np.stack([np.arange(count), np.arange(count) + count])
    sent = sending_to_floor(sides)
    assert sent.shape[1] <= light_transport.MAX_FLOOR_LIGHT_POINTS
    np.testing.assert_array_equal(sent[1] - sent[0], count)
    np.testing.assert_array_equal(sent[0], sides[0, ::3])
