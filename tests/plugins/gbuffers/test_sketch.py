"""The G-buffer `sketch`: the same channels, light and shadow as `surfels`, with small deviations."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.camera import Camera
from z2p_core.parallel import without_second_core
from z2p_core.scene import SceneDescription
from z2p_core.shading.channels import NORMAL_XY, RADIANCE, GBufferChannel
from z2p_renderer.plugins.gbuffers.sketch import Sketch
from z2p_renderer.plugins.gbuffers.surfels import Surfels

CAMERA = Camera(128, 128)
SCENE = SceneDescription(material={"Base Color": (0.5, 0.25, 0.0, 1.0)})
COVERAGE, DEPTH, SHADOW = GBufferChannel.COVERAGE, GBufferChannel.DEPTH, GBufferChannel.SHADOW


def sphere(count: int) -> np.ndarray:
    """Random points (count, 3) on the unit sphere."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def two_balls(count: int = 6000) -> np.ndarray:
    """A large ball and a small one in its shadow."""
    return np.float32(np.concatenate([0.6 * sphere(count), 0.25 * sphere(count // 4) + [0.4, -0.5, -0.35]]))


@pytest.fixture(scope="module")
def full() -> np.ndarray:
    return Surfels().draw(two_balls(), CAMERA, SCENE)


@pytest.fixture(scope="module")
def sketch() -> np.ndarray:
    return Sketch().draw(two_balls(), CAMERA, SCENE)


def test_surfels_lie_where_those_of_surfels_do(full: np.ndarray, sketch: np.ndarray) -> None:
    assert sketch.shape == full.shape and Sketch.channels == Surfels.channels
    assert np.abs(sketch[COVERAGE] - full[COVERAGE]).mean() < 0.002
    inside = (full[COVERAGE] == 1) & (sketch[COVERAGE] == 1)
    off = np.abs(sketch - full)[:, inside]
    assert off[DEPTH].mean() < 0.002
    assert off[NORMAL_XY].mean() < 0.01


def test_light_and_shadow_are_close_to_those_of_surfels(full: np.ndarray, sketch: np.ndarray) -> None:
    inside = (full[COVERAGE] == 1) & (sketch[COVERAGE] == 1)
    off = (sketch - full)[RADIANCE, inside]
    assert np.abs(off.mean()) < 0.01 and np.abs(off).mean() < 0.02
    outside = full[COVERAGE] == 0
    off = (sketch - full)[SHADOW, outside]
    assert full[SHADOW, outside].max() > 0.4
    assert np.abs(off.mean()) < 0.003 and np.abs(off).mean() < 0.006


def test_weights_for_surfels_can_be_trained_on_with_sketch() -> None:
    assert Sketch.refines == Surfels.name


@pytest.mark.parametrize("count", [2, 3, 40, 50_000])
def test_any_number_of_points_is_drawn(count: int) -> None:
    picture = Sketch().draw(np.float32(0.6 * sphere(count)), CAMERA, SCENE)
    assert np.isfinite(picture).all() and picture[COVERAGE].max() > 0


def test_one_core_and_two_draw_the_same(sketch: np.ndarray) -> None:
    with without_second_core():
        np.testing.assert_array_equal(Sketch().draw(two_balls(), CAMERA, SCENE), sketch)
