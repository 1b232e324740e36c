"""Gaps in a depth camera's surface are closed with what lies between, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.camera import turn
from z2p_core.interfaces import Sensor
from z2p_core.placement.depth_gaps import fill_depth_gaps

CAMERA = Sensor(np.zeros(3), np.eye(3))
SIDE, HALF = 80, 0.4


def seen(depth: np.ndarray) -> np.ndarray:
    """Points that a camera sees at depths (SIDE, SIDE), none where they are not finite."""
    steps = np.linspace(-HALF, HALF, SIDE)
    u, v = np.meshgrid(steps, steps)
    points = np.stack([u * depth, v * depth, depth], axis=-1).reshape(-1, 3)
    return points[np.isfinite(points[:, 2])]


def slope(gradient: float = 0.5) -> np.ndarray:
    """Depths (SIDE, SIDE) of a plane z = 1 + gradient x + 0.2 y."""
    steps = np.linspace(-HALF, HALF, SIDE)
    u, v = np.meshgrid(steps, steps)
    return 1 / (1 - gradient * u - 0.2 * v)


def lost(depth: np.ndarray, rows: slice, columns: slice) -> np.ndarray:
    depth = depth.copy()
    depth[rows, columns] = np.nan
    return seen(depth)


@pytest.mark.parametrize("gradient", [0.0, 0.5, 1.8])
def test_a_gap_in_a_plane_is_closed_on_the_plane(gradient: float) -> None:
    whole = slope(gradient)
    added = fill_depth_gaps(lost(whole, slice(40, 46), slice(30, 37)), CAMERA)
    assert 6 <= len(added) <= 42
    pixel = 2 * HALF / (SIDE - 1)
    off = added[:, 2] - (1 + gradient * added[:, 0] + 0.2 * added[:, 1])
    assert np.abs(off).max() < 2.2 * pixel * max(gradient, 0.2)  # the rim's depths are means over pixels
    place = added[:, :2] / added[:, 2:] / pixel + (SIDE - 1) / 2
    assert (place.min(0) > [29, 39]).all() and (place.max(0) < [37, 46]).all()


def test_what_is_whole_stays_as_it_is() -> None:
    assert len(fill_depth_gaps(seen(slope()), CAMERA)) == 0
    assert len(fill_depth_gaps(np.empty((0, 3)), CAMERA)) == 0
    assert len(fill_depth_gaps(np.ones((50, 3)), CAMERA)) == 0  # all in one place


@pytest.mark.parametrize(
    ("rows", "columns"),
    [(slice(20, 50), slice(20, 50)), (slice(40, 44), slice(0, 5)), (slice(0, 4), slice(40, 44)),
     (slice(0, 80), slice(40, 44))],
    ids=["wide", "at the left", "at the top", "across the picture"],
)  # fmt: skip
def test_wide_and_open_gaps_stay(rows: slice, columns: slice) -> None:
    assert len(fill_depth_gaps(lost(slope(), rows, columns), CAMERA)) == 0


def test_a_gap_behind_a_step_stays() -> None:
    """A near thing hides a strip of what is behind it from one of a stereo camera's eyes."""
    depth = np.full((SIDE, SIDE), 1.5)
    depth[20:60, 20:40] = 1.0
    assert len(fill_depth_gaps(lost(depth, slice(20, 60), slice(40, 46)), CAMERA)) == 0


def test_a_gap_that_shows_what_is_behind_stays() -> None:
    depth = slope()
    depth[40:46, 30:37] = 5.0
    assert len(fill_depth_gaps(seen(depth), CAMERA)) == 0


@pytest.mark.parametrize("count", [5_000, 20_000])
def test_random_points_have_no_gaps_to_speak_of(count: int) -> None:
    across = np.random.default_rng(0).uniform(-0.4, 0.4, (count, 2))
    depth = 1 + 0.3 * np.sin(5 * across[:, 0])
    points = np.column_stack([across * depth[:, None], depth])
    assert len(fill_depth_gaps(points, CAMERA)) <= 0.002 * count
    torn = points[(np.abs(across) > 4 / count**0.5).any(axis=1)]
    added = fill_depth_gaps(torn, CAMERA)
    amid = (np.abs(added[:, :2] / added[:, 2:]) < 5 / count**0.5).all(axis=1)
    assert amid.sum() >= 4


def test_points_too_uneven_for_a_camera_stay_as_they_are() -> None:
    ball = np.random.default_rng(0).normal(size=(16_000, 3))  # half of it is seen, dense at its rim
    ball *= 0.8 / np.linalg.norm(ball, axis=1, keepdims=True)
    assert len(fill_depth_gaps(ball[ball[:, 2] <= 0] + [0.0, 0.0, 3.0], CAMERA)) == 0


def test_a_dense_clump_amid_a_wide_view_needs_no_huge_picture() -> None:
    clump = np.random.default_rng(0).normal(scale=1e-6, size=(15_000, 3))
    clump[:, 2] += 1
    assert len(fill_depth_gaps(np.vstack([seen(slope()), clump]), CAMERA)) == 0


def test_neither_order_nor_place_matters() -> None:
    points = lost(slope(), slice(40, 46), slice(30, 37))
    added = fill_depth_gaps(points, CAMERA)
    mixed = fill_depth_gaps(np.random.default_rng(0).permutation(points), CAMERA)
    np.testing.assert_allclose(mixed, added, atol=1e-9)
    moved = Sensor(np.array([3.0, -2.0, 5.0]), turn(40.0))
    elsewhere = fill_depth_gaps(points @ moved.rotation.T + moved.position, moved)
    assert len(elsewhere) == len(added)
    np.testing.assert_allclose((elsewhere - moved.position) @ moved.rotation, added, atol=1e-5)


def test_points_behind_or_far_aside_are_no_cameras() -> None:
    points = lost(slope(), slice(40, 46), slice(30, 37))
    assert len(fill_depth_gaps(np.vstack([points, [[0.0, 0.0, -1.0]]]), CAMERA)) == 0
    assert len(fill_depth_gaps(np.vstack([points, [[30.0, 0.0, 1.0]]]), CAMERA)) == 0
