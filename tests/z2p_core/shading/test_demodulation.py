"""Relative radiance multiplies a picture in linear light, and reaches beyond the outline."""

import numpy as np

from z2p_core.images import linear_from_srgb, srgb_from_linear
from z2p_core.shading.demodulation import FULL_COVERAGE, apply_relative_radiance, reduce_light


def test_colors_are_multiplied_in_linear_light() -> None:
    rng = np.random.default_rng(0)
    alpha = rng.uniform(0.2, 1, (40, 30)).astype(np.float32)
    straight = rng.uniform(0, 1, (3, 40, 30)).astype(np.float32)
    factors = rng.uniform(0, 2, (3, 40, 30)).astype(np.float32)
    image = np.concatenate([straight * alpha, alpha[None]])
    apply_relative_radiance(image, factors, np.ones_like(alpha))
    expected = srgb_from_linear(np.minimum(linear_from_srgb(straight) * factors, 1)) * alpha
    np.testing.assert_allclose(image[:3], expected, atol=2e-5)
    assert np.array_equal(image[3], alpha)


def test_factors_of_1_change_nothing() -> None:
    image = np.random.default_rng(0).uniform(0, 1, (4, 16, 16)).astype(np.float32)
    image[3] = 1
    before = image.copy()
    apply_relative_radiance(image, np.ones((3, 16, 16), np.float32), np.ones((16, 16), np.float32))
    np.testing.assert_allclose(image, before, atol=1e-5)


def test_pixels_beyond_the_coverage_get_the_factors_nearby() -> None:
    factors, coverage = np.zeros((3, 33, 47), np.float32), np.zeros((33, 47), np.float32)
    coverage[:, :10], coverage[:, 37:] = 1, 0.5
    factors[0, :, :10], factors[2, :, 37:] = 1, 1
    image = np.ones((4, 33, 47), np.float32)
    apply_relative_radiance(image, factors, coverage)
    np.testing.assert_allclose(image[:3, coverage > FULL_COVERAGE], factors[:, coverage > FULL_COVERAGE], atol=1e-5)
    linear = linear_from_srgb(image[:3])
    assert (linear[0, :, 12] > 0.6).all() and (linear[2, :, 34] > 0.6).all()
    np.testing.assert_allclose(linear.sum(0), 1, atol=1e-4)  # means of 1 everywhere, never 0


def test_a_transparent_image_stays_as_it_is() -> None:
    image = np.zeros((4, 8, 8), np.float32)
    apply_relative_radiance(image, np.ones((3, 8, 8), np.float32), np.zeros((8, 8), np.float32))
    assert not image.any()


def test_without_light_the_surface_has_one_color() -> None:
    image = np.zeros((4, 2, 3), np.float32)
    image[:, 0] = np.array([[0.1], [0.5], [0.3], [1.0]])  # lit surface
    image[3, 1] = 0.4  # the floor's shadow
    coverage = np.array([[1, 1, 0.5], [0, 0, 0]], np.float32)
    lit, color = image.copy(), np.array([0.2, 0.2, 0.2], np.float32)
    reduce_light(image, color, coverage, 0.0)
    assert np.allclose(image[:3, 0, :2], srgb_from_linear(color)[:, None], atol=1e-5)
    assert np.array_equal(image[:, 1], lit[:, 1])
    between = lit.copy()
    reduce_light(between, color, coverage, 1.0)
    assert np.allclose(between, lit, atol=1e-6)
