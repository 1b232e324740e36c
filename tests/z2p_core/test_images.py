"""Colour and alpha survive their round trips, and pictures are averaged in linear premultiplied light."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from z2p_core.images import (
    area_average,
    bytes_from_unit,
    composite,
    linear_from_srgb,
    premultiplied_from_straight,
    shrink,
    srgb_from_linear,
    straight_from_premultiplied,
    unit_from_bytes,
)

unit = st.floats(0, 1)
pictures = hnp.arrays(np.float64, st.tuples(st.integers(1, 6), st.integers(1, 6), st.just(4)), elements=unit)


@given(unit)
def test_srgb_and_linear_are_inverse(value: float) -> None:
    assert srgb_from_linear(linear_from_srgb(value)) == pytest.approx(value, abs=1e-6)
    assert linear_from_srgb(srgb_from_linear(value)) == pytest.approx(value, abs=1e-6)


@given(unit, unit)
def test_linear_light_is_monotonic_in_srgb(one: float, other: float) -> None:
    assert (one <= other) == (linear_from_srgb(one) <= linear_from_srgb(other)) or one == pytest.approx(other)


@pytest.mark.parametrize(("srgb", "linear"), [(0, 0), (0.04045, 0.0031308), (0.5, 0.2140411), (1, 1)])
def test_srgb_follows_the_standards_curve(srgb: float, linear: float) -> None:
    assert linear_from_srgb(srgb) == pytest.approx(linear, abs=1e-6)


def test_every_byte_survives_the_round_trip() -> None:
    levels = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(bytes_from_unit(unit_from_bytes(levels)), levels)
    np.testing.assert_array_equal(bytes_from_unit(srgb_from_linear(linear_from_srgb(unit_from_bytes(levels)))), levels)
    assert unit_from_bytes(levels).dtype == np.float32


def test_bytes_are_clipped_not_wrapped() -> None:
    np.testing.assert_array_equal(bytes_from_unit(np.array([-0.2, 1.7])), [0, 255])


@given(pictures)
def test_premultiplying_is_invertible_where_alpha_is_positive(picture: np.ndarray) -> None:
    back = straight_from_premultiplied(premultiplied_from_straight(picture))
    np.testing.assert_array_equal(back[..., 3], picture[..., 3])
    solid = picture[..., 3] > 1e-6
    np.testing.assert_allclose(back[solid], picture[solid], atol=1e-9)
    assert not back[~solid][..., :3].any()


@given(pictures, st.tuples(unit, unit, unit))
def test_composite_lies_between_color_and_background(picture: np.ndarray, background: tuple[float, ...]) -> None:
    over = composite(picture, background)
    color, behind = picture[..., :3], np.broadcast_to(background, picture[..., :3].shape)
    assert over.shape == color.shape
    assert (over >= np.minimum(color, behind) - 1e-12).all() and (over <= np.maximum(color, behind) + 1e-12).all()


def test_compositing_opaque_and_clear() -> None:
    picture = np.array([[0.2, 0.4, 0.6, 1.0], [0.2, 0.4, 0.6, 0.0], [0.2, 0.4, 0.6, 0.5]])
    over = composite(picture, (1.0, 1.0, 1.0))
    np.testing.assert_allclose(over, [[0.2, 0.4, 0.6], [1, 1, 1], [0.6, 0.7, 0.8]])


def test_shrinking_averages_light_not_srgb_values() -> None:
    picture = np.ones((2, 2, 4))
    picture[0, :, :3] = 0  # half black, half white
    (pixel,) = shrink(picture, 2)[0]
    assert pixel[:3] == pytest.approx(float(srgb_from_linear(0.5)), abs=1e-5)
    assert shrink(picture, 2).dtype == np.float32


def test_transparent_pixels_add_no_color_when_shrunk() -> None:
    picture = np.zeros((2, 2, 4))
    picture[0, 0] = (0.8, 0.3, 0.1, 1.0)
    picture[1, 1] = (0.0, 1.0, 0.0, 0.0)  # green that nobody sees
    np.testing.assert_allclose(shrink(picture, 2)[0, 0], (0.8, 0.3, 0.1, 0.25), atol=1e-5)


@given(pictures)
def test_shrinking_by_one_and_flat_images_change_nothing(picture: np.ndarray) -> None:
    solid = picture.copy()
    solid[..., 3] = np.maximum(solid[..., 3], 0.01)
    np.testing.assert_allclose(shrink(solid, 1), solid, atol=1e-5)
    pixel = solid[:1, :1]
    np.testing.assert_allclose(shrink(np.tile(pixel, (4, 4, 1)), 2), np.tile(pixel, (2, 2, 1)), atol=1e-5)


def test_area_average_keeps_the_mean_and_checks_the_factor() -> None:
    picture = np.random.default_rng(0).uniform(size=(6, 9, 4))
    small = area_average(picture, 3)
    assert small.shape == (2, 3, 4)
    np.testing.assert_allclose(small.mean((0, 1)), picture.mean((0, 1)))
    assert area_average(picture[..., 0], 3).shape == (2, 3)
    with pytest.raises(ValueError, match="multiples of 4, got 9x6"):
        area_average(picture, 4)
