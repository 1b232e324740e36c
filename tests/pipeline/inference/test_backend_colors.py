"""Per-point colors in `z2p_core.render`: each point has its own, and what cannot be drawn so is said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import z2p_core
from z2p_core.api.render import RenderWarning
from z2p_core.interfaces import SettingError
from z2p_renderer.plugins.gbuffers.surfels import Surfels

RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)


@pytest.fixture
def ball() -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(3000, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def halves(ball: np.ndarray) -> np.ndarray:
    """Red where x < 0, blue elsewhere."""
    return np.where(ball[:, :1] < 0, RED, BLUE)


def channel_sums(picture: np.ndarray) -> tuple[float, float]:
    """Red and blue of the opaque pixels of an image (H, W, 4)."""
    opaque = picture[picture[..., 3] > 250].astype(float)
    return float(opaque[:, 0].sum()), float(opaque[:, 2].sum())


@pytest.mark.parametrize("weights", ["regular", "material"])
def test_two_halves_of_a_ball_have_their_colors(ball: np.ndarray, weights: str) -> None:
    picture = z2p_core.render(ball, halves(ball), view="front", size=128, weights=weights)
    assert picture.record["color_by"] == "rgb"
    left, right = picture.array[:, :60], picture.array[:, 68:]
    for half, (more, less) in ((left, (0, 1)), (right, (1, 0))):
        sums = channel_sums(half)
        assert sums[more] > 2.5 * sums[less]


def test_one_color_for_all_points_equals_that_color(ball: np.ndarray) -> None:
    options: dict[str, Any] = {"view": "front", "size": 128}
    each = z2p_core.render(ball, np.tile(RED, (len(ball), 1)), background="white", **options).array.astype(int)
    whole = z2p_core.render(ball, color=RED, background="white", **options).array.astype(int)
    assert np.abs(each - whole).max() <= 2


def test_colors_survive_removed_and_shuffled_points(ball: np.ndarray) -> None:
    colors = halves(ball)
    options: dict[str, Any] = {"view": "front", "size": 96}
    plain = z2p_core.render(ball, colors, **options).array.astype(int)
    order = np.random.default_rng(1).permutation(len(ball))
    more = np.vstack([ball[order], np.full((5, 3), np.nan), ball[:50]])
    with pytest.warns(RenderWarning, match="not finite"):
        other = z2p_core.render(more, np.vstack([colors[order], np.ones((5, 3)), colors[:50]]), **options)
    assert np.abs(other.array.astype(int) - plain).mean() < 1


def test_unknown_colors_are_those_of_their_neighbors(ball: np.ndarray) -> None:
    colors = halves(ball)
    known = z2p_core.render(ball, colors, view="front", size=96).array.astype(int)
    colors[::3] = np.nan
    partly = z2p_core.render(ball, colors, view="front", size=96).array.astype(int)
    assert np.abs(partly - known).mean() < 3


def test_few_points_become_balls_of_their_colors(ball: np.ndarray) -> None:
    with pytest.warns(RenderWarning, match="balls"):
        picture = z2p_core.render(ball[:20], np.tile(BLUE, (20, 1)), size=128)
    red, blue = channel_sums(picture.array)
    assert blue > 3 * red


def test_each_cloud_of_a_batch_has_its_own_colors(ball: np.ndarray) -> None:
    colors = [np.tile(RED, (len(ball), 1)), np.tile(BLUE, (900, 1))]
    red, blue = z2p_core.render([ball, ball[:900]], colors, size=64).parts
    assert np.subtract(*channel_sums(red.array)) > 0 > np.subtract(*channel_sums(blue.array))


def test_integers_and_floats_mean_the_same_colors(ball: np.ndarray) -> None:
    colors = np.random.default_rng(0).integers(0, 256, (len(ball), 3))
    given = (colors, colors.astype(np.uint8), colors / 255, (colors / 255).astype(np.float32))
    pictures = [z2p_core.render(ball, one, size=48).array.astype(int) for one in given]
    assert all(np.abs(picture - pictures[0]).max() <= 1 for picture in pictures)


def test_color_replaces_the_colors_of_points(ball: np.ndarray) -> None:
    with pytest.warns(RenderWarning, match="has the colour given"):
        picture = z2p_core.render(ball, halves(ball), color="lime", size=48)
    assert np.array_equal(picture.array, z2p_core.render(ball, color="lime", size=48).array)
    assert "color_by" not in picture.record


def test_weights_without_textures_draw_the_mean_and_say_so(
    ball: np.ndarray, tiny_weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Surfels, "draws_textures", False)
    with pytest.warns(RenderWarning, match="no per-point colours: the whole object has their mean, #ff8000"):
        picture = z2p_core.render(ball, np.full(ball.shape, (255, 128, 0), np.uint8), weights=tiny_weights, size=48)
    assert picture.record["controls"]["color"] == pytest.approx([1, 128 / 255, 0])


BAD_COLORS = {
    "nan": (np.full((3000, 3), np.nan), "only nan"),
    "large": (np.full((3000, 3), 7.5), "from 0 to 1 or integers to 255, got 7.5"),
    "negative": (np.full((3000, 3), -0.5), "got -0.5"),
    "too few": (np.zeros((2999, 3)), "for each of the 3000 points, got 2999"),
    "two channels": (np.zeros((3000, 2)), r"\(3000, 2\)"),
    "words": (["red"] * 3000, "as numbers"),
}


@pytest.mark.parametrize("kind", BAD_COLORS)
def test_other_colors_are_refused(ball: np.ndarray, kind: str) -> None:
    colors, message = BAD_COLORS[kind]
    with pytest.raises(SettingError, match=message):
        z2p_core.render(ball, colors, size=48)
