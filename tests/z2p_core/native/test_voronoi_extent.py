"""Extents of Voronoi cells against known values: on grids, random sheets, borders and creases."""

import numpy as np
import pytest

from z2p_core import native

UP = np.float32([0, 0, 1])


def extents_of(points, normals=None, in_space=False):
    grid, query_indices = native.NeighborGrid(np.float32(points)), np.arange(len(points), dtype=np.int32)
    neighbors, _ = grid.neighbors(query_indices, 24)
    normals = np.tile(UP, (len(points), 1)) if normals is None else normals(grid.points)
    return grid.points, native.voronoi_extent(grid.points, normals, query_indices, neighbors, in_space)[0]


def sheet_of(side):
    x, y = np.mgrid[:side, :side].reshape(2, -1) / side
    return np.column_stack([x, y, np.zeros(side**2)])


def within(points, margin=0.15):
    return (np.abs(points[:, :2] - 0.5) < 0.5 - margin).all(1)


def test_extent_on_a_rotated_grid_is_half_a_diagonal():
    expected = np.sqrt(0.5) / 30
    for rotation in (0.0, 0.3, 0.7):
        turn = np.array([[np.cos(rotation), -np.sin(rotation), 0], [np.sin(rotation), np.cos(rotation), 0], [0, 0, 1]])
        sheet = sheet_of(30) - [0.5, 0.5, 0]
        points, extents = extents_of(sheet @ turn.T)
        middle = np.hypot(points[:, 0], points[:, 1]) < 0.3
        # corners may lie between two of the sixteen directions, 11 degrees from the nearer
        assert (extents[middle] <= expected * 1.001).all() and (extents[middle] > 0.88 * expected).all()


def test_discs_a_tenth_wider_than_cells_cover_a_random_sheet():
    rng = np.random.default_rng(0)
    points, extents = extents_of(np.column_stack([rng.random((2_000, 2)), np.zeros(2_000)]))
    extents[extents > 0.15] = 0  # cells at the border are open
    positions = rng.uniform(0.15, 0.85, (4_000, 2))
    away = np.linalg.norm(positions[:, None] - points[None, :, :2], axis=2)
    assert (away < 1.1 * extents).any(1).all()
    assert not (away < 0.6 * extents).any(1).all()


def test_border_cells_are_open_and_another_sheet_is_ignored():
    points, extents = extents_of(sheet_of(20))
    at_border = (points[:, :2] == 0).any(1) | (points[:, :2] > 0.945).any(1)
    assert (extents[at_border] > 1).all() and (extents[within(points)] < 0.05).all()
    above = np.concatenate([sheet_of(20), sheet_of(20) + np.float32([0, 0, 0.02])])  # closer than its neighbors
    points, extents = extents_of(above)
    inner = within(points)
    np.testing.assert_allclose(extents[inner], np.sqrt(0.5) / 20, rtol=0.13)


def test_extent_is_measured_in_the_tangent_plane():
    sheet = sheet_of(30)
    normal = np.float32([-1, 0, 1]) / np.float32(np.sqrt(2))
    sheet[:, 2] = sheet[:, 0]
    points, extents = extents_of(sheet, lambda points: np.tile(normal, (len(points), 1)))
    np.testing.assert_allclose(extents[within(points)], np.hypot(np.sqrt(2), 1) / 2 / 30, rtol=0.13)


def test_cells_in_space_end_at_a_crease():
    floor = sheet_of(20)
    wall = np.column_stack([np.full(400, 0.975), floor[:, 1], -0.05 - floor[:, 0]])  # down from the end of the floor
    points, in_space = extents_of(np.concatenate([floor, wall]), in_space=True)
    middle = (points[:, 2] == 0) & (np.abs(points[:, 1] - 0.5) < 0.3)
    edge, border = middle & (points[:, 0] == points[middle, 0].max()), middle & (points[:, 0] == 0)
    assert (in_space[edge] < 1.5 / 20).all() and edge.sum() > 8
    assert (in_space[border] > 3 / 20).all()


def test_only_queried_points_are_measured():
    points, extents = extents_of(sheet_of(20))
    grid, query_indices = native.NeighborGrid(np.float32(points)), np.array([7, 300, 12], np.int32)
    neighbors, _ = grid.neighbors(query_indices, 24)
    normals = np.tile(UP, (len(points), 1))
    measured, farthest = native.voronoi_extent(grid.points, normals, query_indices, neighbors)
    np.testing.assert_array_equal(measured, extents[query_indices])
    distances = np.linalg.norm(farthest - points[query_indices], axis=1)
    np.testing.assert_allclose(distances, extents[query_indices], rtol=1e-5)
    assert not farthest[:, 2].any()


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.zeros((40, 3))])
def test_single_and_coincident_points_have_open_cells(points):
    assert np.isinf(extents_of(points)[1]).all()
