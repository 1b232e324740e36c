"""Shadows fade to zero at an image's edges; nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.shading.shadow_fade import FADE_WIDTH, OPAQUE_ALPHA, fade_shadow


@pytest.mark.parametrize("shape", [(100, 100), (60, 140), (32, 32), (33, 4096)])
def test_shadow_is_zero_at_the_edge_and_unchanged_inside(shape: tuple[int, int]) -> None:
    picture = np.full((*shape, 4), 120, np.uint8)
    band = round(FADE_WIDTH * min(shape))
    alpha = fade_shadow(picture)[..., 3]
    assert max(alpha[0].max(), alpha[-1].max(), alpha[:, 0].max(), alpha[:, -1].max()) == 0
    assert (alpha[band:-band, band:-band] == 120).all() and (picture[..., 3] == 120).all(), "the given one stays"
    steps = np.diff(alpha[shape[0] // 2, : band + 1].astype(int))
    assert (steps >= 0).all() and steps.max() <= 2 * 120 / band + 1, "nowhere a step"


def test_the_object_is_never_faded() -> None:
    picture = np.zeros((50, 50, 4), np.uint8)
    picture[10:, 20:30] = (200, 100, 50, 255)  # runs out of the frame
    picture[10:, 30] = (200, 100, 50, 128)  # its outline, half of each pixel
    picture[40:, 32:, 3] = 100  # its shadow
    after = fade_shadow(picture)
    assert np.array_equal(after[:, :31], picture[:, :31])
    assert (after[-1, 32:, 3] == 0).all() and after[44, 40, 3] == 100 > after[47, 40, 3]


def test_fading_shadow_keeps_the_light_of_the_outline() -> None:
    picture = np.zeros((50, 50, 4), np.uint8)
    picture[10:, 20:30] = (200, 100, 50, 255)
    picture[10:, 30] = (133, 67, 33, 192)  # half object, half a shadow of alpha 128
    picture[10:, 31:, 3] = 128
    edge = fade_shadow(picture)[-1, 30:33].astype(int)
    assert abs(edge[0] - (200, 100, 50, 128)).max() <= 2, "the object's half alone"
    assert (edge[1:, 3] == 0).all()


def test_a_black_object_is_not_faded() -> None:
    picture = np.zeros((50, 50, 4), np.uint8)
    picture[10:, 20:30, 3] = 255
    assert np.array_equal(fade_shadow(picture)[:, 20:30], picture[:, 20:30])


def test_a_dark_shadow_fades_too() -> None:
    picture = np.zeros((50, 50, 4), np.uint8)
    picture[..., 3] = OPAQUE_ALPHA - 1
    assert fade_shadow(picture)[0].max() == 0


def test_images_of_one_or_two_pixels_do_not_fail() -> None:
    for shape in ((1, 1), (1, 40), (2, 2)):
        assert fade_shadow(np.full((*shape, 4), 100, np.uint8)).shape == (*shape, 4)
