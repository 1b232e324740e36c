"""Screen-space filling: a ball is closed and shaded, and points that it hides do not show through."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.scene import SceneDescription

CAMERA = Camera(96, 96)


def ball(count: int, radius: float = 0.6, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return (radius * points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)


def paint(cloud: np.ndarray, **described: object) -> np.ndarray:
    picture: np.ndarray = registry.load("painters", "screen")().paint(cloud, CAMERA, SceneDescription(**described))
    return picture


def inside(share: float) -> np.ndarray:
    """The pixels within a share of the ball's radius on the screen."""
    row, column = np.indices((96, 96)) + 0.5
    return np.hypot(row - 48, column - 48) < share * CAMERA.focal * 0.6 / 3.55


def test_closing_gaps_does_not_reach_the_images_edge() -> None:
    """Closing gaps must not draw a line from the object to a border that it is near."""
    alpha = paint(ball(300, radius=0.95))[..., 3]
    border = np.concatenate([alpha[:3].ravel(), alpha[-3:].ravel(), alpha[:, :3].ravel(), alpha[:, -3:].ravel()])
    assert border.max() == 0 and alpha.mean() > 0.3


@pytest.mark.parametrize(("count", "closed"), [(600, 0.9), (2000, 0.97), (20_000, 0.99)])
def test_a_ball_is_closed_and_ends_at_its_outline(count: int, closed: float) -> None:
    alpha = paint(ball(count))[..., 3]
    assert alpha[inside(0.85)].mean() > closed
    assert alpha[~inside(1.25)].max() == 0


def test_the_side_towards_the_light_is_brighter() -> None:
    left, right = (paint(ball(5000), light=(3.5, azimuth, 45.0))[..., :3].mean(-1) for azimuth in (-80.0, 80.0))
    half = np.indices((96, 96))[1] < 48
    core = inside(0.8)
    assert left[core & half].mean() > left[core & ~half].mean() + 0.1
    assert right[core & ~half].mean() > right[core & half].mean() + 0.1


def test_hidden_points_do_not_shine_through() -> None:
    hollow = paint(ball(5000))
    filled = paint(np.concatenate([ball(5000), ball(2000, radius=0.35, seed=1)]))
    core = inside(0.8)
    assert np.abs(hollow - filled)[core].mean() < 0.02


def test_the_surface_has_its_base_color() -> None:
    colors = paint(ball(5000), material={"Base Color": (0.8, 0.05, 0.05, 1.0)})[inside(0.7)]
    assert colors[:, 0].mean() > 2 * colors[:, 1].mean()


def test_colored_points_keep_their_sides() -> None:
    cloud = ball(5000)
    albedo = np.where(cloud[:, :1] < 0, (0.7, 0.1, 0.1), (0.1, 0.1, 0.7)).astype(np.float32)
    picture = registry.load("painters", "screen")().paint_colored(cloud, albedo, CAMERA, SceneDescription())
    redder = picture[..., 0] > picture[..., 2]
    left = np.indices((96, 96))[1] < 48
    assert redder[inside(0.8) & left].mean() > 0.97 and redder[inside(0.8) & ~left].mean() < 0.03
    np.testing.assert_array_equal(picture[..., 3], paint(cloud)[..., 3])
