"""Samples of the light have its position, shape and power."""

import numpy as np
import pytest

from z2p_core.camera import light_position
from z2p_core.scene import LIGHT_RADIANCE, LIGHT_SIDE
from z2p_core.shading.area_light import (
    area_light_quad,
    area_light_samples,
    cosine_hemisphere,
    hemisphere_axes,
    jittered_sample_sets,
)


def test_the_area_light_is_a_square_that_faces_the_origin():
    light = (3.5, -30.0, 60.0)
    samples, axes, powers = area_light_samples(light, 64)
    center = light_position(light)
    np.testing.assert_allclose(samples.mean(0), center, atol=1e-9)
    np.testing.assert_allclose((samples - center) @ center, 0, atol=1e-9)
    np.testing.assert_allclose(axes @ center, -3.5, atol=1e-9)
    across = np.cross(center, [0, 0, 1])
    columns = np.unique(((samples - center) @ across / np.linalg.norm(across)).round(6))
    np.testing.assert_allclose(columns, ((np.arange(8) + 0.5) / 8 - 0.5) * LIGHT_SIDE, atol=1e-6)
    assert powers.sum() == pytest.approx(LIGHT_RADIANCE * LIGHT_SIDE**2)


@pytest.mark.parametrize("sets", [1, 2, 4])
def test_jittered_sample_sets_interlock_on_the_same_square(sets):
    light = (3.5, -30.0, 60.0)
    center, *sides = area_light_quad(light)
    offsets = np.concatenate(jittered_sample_sets(light, 64, sets)) - center
    np.testing.assert_allclose(offsets.mean(0), 0, atol=1e-9)
    on_square = offsets @ np.transpose(sides) / LIGHT_SIDE**2
    assert np.abs(on_square).max() < 0.5
    distances = np.linalg.norm(on_square[:, None] - on_square, axis=2) + 9 * np.eye(len(offsets))
    np.testing.assert_allclose(distances.min(1), 1 / 8 / np.sqrt(sets), atol=1e-9)
    assert np.array_equal(jittered_sample_sets(light, 64, 1)[0], area_light_samples(light, 64)[0])


def test_hemisphere_axes_point_up_and_are_uniform():
    sky = hemisphere_axes(24)
    np.testing.assert_allclose(np.linalg.norm(sky, axis=1), 1)
    assert (sky[:, 2] > 0).all() and np.abs(sky[:, :2].mean(0)).max() < 0.06
    assert sky[:, 2].mean() == pytest.approx(0.5, abs=1e-6)


def test_cosine_hemisphere_gives_each_direction_equal_light():
    directions = cosine_hemisphere(4096)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-12)
    assert directions[:, 2].mean() == pytest.approx(2 / 3, abs=0.01)  # mean cosine of a cosine-weighted density
    assert np.abs(directions[:, :2].mean(0)).max() < 0.01
