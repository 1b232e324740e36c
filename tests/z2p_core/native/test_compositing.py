"""Blending of images towards colors and shadows, and their conversion to bytes, against plain numpy."""

import numpy as np

from z2p_core import native
from z2p_core.images import bytes_from_unit, straight_from_premultiplied


def test_straight_rgba_bytes_equal_plain_numpy():
    rng = np.random.default_rng(0)
    planes = rng.uniform(-0.1, 1.1, (4, 50, 61)).astype(np.float32)
    planes[:3] *= planes[3]
    planes[3, ::7], planes[3, 1::7] = 0, 1e-7
    expected = bytes_from_unit(straight_from_premultiplied(np.clip(planes, 0, 1).transpose(1, 2, 0)))
    converted = native.to_straight_rgba8(planes)
    assert converted.dtype == np.uint8 and converted.shape == (50, 61, 4) and not converted[::7].any()
    assert np.abs(converted.astype(int) - expected).max() <= 1 and (converted != expected).mean() < 1e-3
    invalid = np.full((4, 2, 2), np.nan, np.float32)
    assert not native.to_straight_rgba8(invalid).any()


def test_colors_are_blended_only_where_both_are_opaque():
    rng = np.random.default_rng(0)
    image = rng.uniform(0.2, 0.8, (4, 40, 50)).astype(np.float32)
    coverage, colors = rng.uniform(0.8, 1, (40, 50)).astype(np.float32), rng.random((3, 40, 50), np.float32)
    image[3] = rng.uniform(0.9, 1, (40, 50))
    before = image.copy()
    native.blend_towards(image, coverage, colors, 0.5, 0.03)
    weight = np.clip(10 * coverage - 9, 0, 1) * np.clip(20 * before[3] - 19, 0, 1)
    difference = np.clip(colors * before[3] - before[:3], -0.03, 0.03)
    np.testing.assert_allclose(image[:3], before[:3] + 0.5 * weight * difference, atol=1e-5)
    np.testing.assert_array_equal(image[3], before[3])
    rim = (coverage <= 0.9) | (before[3] <= 0.95)
    assert 0.2 < rim.mean() < 0.9 and (image[:, rim] == before[:, rim]).all()


def test_shadows_are_blended_only_beside_the_object():
    rng = np.random.default_rng(0)
    alpha, shadow, coverage = rng.random((3, 40, 50), np.float32)
    coverage[:, :25] = 0
    before = alpha.copy()
    native.blend_shadow_towards(alpha, coverage, shadow, 0.5, 0.2)
    difference = shadow - before
    weight = np.clip(1 - 10 * coverage, 0, 1) * np.clip(2 - np.abs(difference) / 0.2, 0, 1)
    np.testing.assert_allclose(alpha, before + 0.5 * weight * difference, atol=1e-5)
    assert (alpha[coverage > 0.1] == before[coverage > 0.1]).all() and (alpha != before).mean() > 0.2
