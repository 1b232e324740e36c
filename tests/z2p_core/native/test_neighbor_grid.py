"""Nearest neighbors by the grid and the k-d tree, against a search through all points."""

import gc

import numpy as np
import pytest
from point_shapes import sphere_of

from z2p_core import native


def squared_distances(positions, points):
    return ((positions[:, None].astype(float) - points) ** 2).sum(2)


@pytest.mark.parametrize("count", [1, 12, 64])
def test_neighbors_are_the_nearest_for_uneven_density(count: int) -> None:
    rng = np.random.default_rng(5)
    distances = np.exp(rng.uniform(-7, 0, (4000, 1)))  # as around a scanner
    cloud = (distances * rng.normal(size=(4000, 3))).astype(np.float32)
    grid = native.NeighborGrid(cloud)
    assert np.array_equal(grid.points, native.NeighborGrid(cloud[::-1]).points)
    query_indices, positions = np.arange(4000, dtype=np.int32), rng.normal(size=(50, 3)).astype(np.float32)
    for queries, neighbors in (
        (grid.points, grid.neighbors(query_indices, count)[0]),
        (positions, grid.neighbors_of_positions(positions, count)),
    ):
        squared = squared_distances(queries, grid.points)
        nearest = np.sort(np.partition(squared, count, axis=1)[:, :count], axis=1)
        np.testing.assert_allclose(np.take_along_axis(squared, neighbors, 1), nearest, rtol=1e-4)
        assert all(len(set(row)) == count for row in neighbors.tolist())


@pytest.mark.parametrize("count", [1, 16, 64])
def test_neighbors_among_crowded_and_repeated_points(count: int) -> None:
    """Thousands in one cell, and points that come three times: nearest first, and of equally near ones the first."""
    rng = np.random.default_rng(2)
    crowd = 1e-3 * rng.random((3000, 3))
    grid = native.NeighborGrid(np.concatenate([rng.random((500, 3)), crowd, crowd[:50], crowd[:50]]).astype(np.float32))
    query_indices = np.flatnonzero((grid.points < 1e-3).all(1)).astype(np.int32)[::7]
    neighbors, _ = grid.neighbors(query_indices, count)
    squared = ((grid.points[query_indices][:, None] - grid.points) ** 2).sum(2)
    expected = np.argsort(squared, axis=1, kind="stable")[:, :count]
    np.testing.assert_allclose(
        np.take_along_axis(squared, neighbors, 1), np.take_along_axis(squared, expected, 1), rtol=1e-4, atol=1e-12
    )
    assert all(len(set(row)) == count for row in neighbors.tolist())


def test_neighbors_of_positions_that_are_no_points() -> None:
    rng = np.random.default_rng(8)
    grid, positions = native.NeighborGrid(sphere_of(2000)), 1.01 * sphere_of(300)
    nearest = np.sort(((positions[:, None] - grid.points) ** 2).sum(2), axis=1)
    neighbors = grid.neighbors_of_positions(positions, 20)
    squared = ((positions[:, None] - grid.points[neighbors]) ** 2).sum(2)
    np.testing.assert_allclose(squared[:, :4], nearest[:, :4], rtol=1e-3)
    clustered = native.NeighborGrid(np.float32([[0, 0, 0], *(0.01 * rng.random((100, 3)) + 1)]))
    remote = np.float32([[0.3, 0.5, 0.4], [90, 0, 0], [-1, -1, -1]])
    assert set(clustered.neighbors_of_positions(remote, 8).ravel()) <= set(range(101))


@pytest.mark.parametrize("crowded", [False, True])
def test_the_nearest_point_is_the_first_neighbor(crowded: bool) -> None:
    points = sphere_of(1500)
    if crowded:
        points = np.vstack([points, [[1e3, 0, 0]]]).astype(np.float32)
    grid = native.NeighborGrid(points)
    positions = np.vstack([points, 1.1 * points, 5 * points]).astype(np.float32)
    nearest = grid.nearest_to_positions(positions)
    np.testing.assert_array_equal(nearest, grid.neighbors_of_positions(positions, 1)[:, 0])
    np.testing.assert_array_equal(grid.points[nearest[: len(points)]], points)


def test_points_that_are_not_finite_are_refused(recwarn: pytest.WarningsRecorder) -> None:
    with pytest.raises(ValueError, match="finite points"):
        native.NeighborGrid(np.full((3, 3), np.nan, np.float32))
    gc.collect()
    assert not [warning for warning in recwarn if issubclass(warning.category, pytest.PytestUnraisableExceptionWarning)]


def test_nearly_all_nearest_points_are_found_by_a_walk() -> None:
    points = sphere_of(3000)
    grid = native.NeighborGrid(np.concatenate([points, 0.97 * points]).astype(np.float32))
    neighbors, _ = grid.neighbors(np.arange(6000, dtype=np.int32), 16)
    positions = grid.points + np.random.default_rng(3).normal(0, 0.01, grid.points.shape).astype(np.float32)
    walked, nearest = grid.nearest_by_walk(positions, neighbors), grid.nearest_to_positions(positions)
    assert (walked == nearest).mean() > 0.97
