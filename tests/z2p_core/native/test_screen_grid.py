"""Neighbors that are found on the screen are those nearest in space."""

from __future__ import annotations

import numpy as np
from point_shapes import sphere_of

from z2p_core import native
from z2p_core.camera import Camera

CAMERA = Camera(256, 256)


def front(count: int) -> np.ndarray:
    """The half of a sphere that the camera sees."""
    points = sphere_of(count).astype(np.float32)
    return points[points @ CAMERA.position > 0.3 * np.linalg.norm(CAMERA.position)]


def nearest(points: np.ndarray, queries: np.ndarray, count: int) -> np.ndarray:
    squared = ((queries[:, None] - points) ** 2).sum(2)
    return np.sqrt(np.sort(np.partition(squared, count, axis=1)[:, :count], axis=1))


def test_nearly_all_neighbors_are_the_nearest() -> None:
    grid = native.ScreenGrid(front(4000), CAMERA)
    queries = np.arange(0, len(grid.points), 5, dtype=np.int32)
    neighbors, spacing = grid.neighbors(queries, 12)
    expected = nearest(grid.points, grid.points[queries], 12)
    found = np.linalg.norm(grid.points[neighbors] - grid.points[queries][:, None], axis=2)
    assert np.array_equal(neighbors[:, 0], queries)
    assert (np.diff(found, axis=1) >= -1e-4).all()
    assert (found[:, 5] < 1.001 * expected[:, 5]).mean() > 0.9
    assert found[:, -1].mean() < 1.05 * expected[:, -1].mean()
    np.testing.assert_allclose(np.median(spacing), np.sqrt(np.pi / 12) * np.median(expected[:, -1]), rtol=0.05)


def test_points_far_behind_find_each_other() -> None:
    behind = np.float32([0, 0.9, 0]) + 0.1 * front(400)
    points = np.concatenate([front(6000), behind])
    grid = native.ScreenGrid(points, CAMERA)
    rows = np.flatnonzero(grid.order >= len(points) - len(behind)).astype(np.int32)
    neighbors, spacing = grid.neighbors(rows, 12)
    assert np.isin(neighbors, rows).all() and spacing.max() < 0.1


def test_the_order_leads_back_to_the_given_points() -> None:
    points = front(1000)
    grid = native.ScreenGrid(points, CAMERA)
    np.testing.assert_array_equal(points[grid.order], grid.points)
    np.testing.assert_array_equal(grid.nearest_to_positions(grid.points), np.arange(len(points)))


def test_few_points_are_enough() -> None:
    grid = native.ScreenGrid(np.float32([[0, 0, 0], [0.5, 0, 0.5]]), CAMERA)
    neighbors, _ = grid.neighbors(np.arange(2), 5)
    np.testing.assert_array_equal(neighbors, [[0, 1, 1, 1, 1], [1, 0, 0, 0, 0]])
