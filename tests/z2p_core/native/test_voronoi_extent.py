"""How far Voronoi cells reach, on grids, random sheets and borders, where that is known."""

import numpy as np
import pytest

from z2p_core import native

UP = np.float32([0, 0, 1])


def reaches_of(points, normals=None, solid=False):
    grid, everyone = native.NeighborGrid(np.float32(points)), np.arange(len(points), dtype=np.int32)
    found, _ = grid.neighbors(everyone, 24)
    normals = np.tile(UP, (len(points), 1)) if normals is None else normals(grid.points)
    return grid.points, native.voronoi_extent(grid.points, normals, everyone, found, solid)[0]


def sheet_of(side):
    x, y = np.mgrid[:side, :side].reshape(2, -1) / side
    return np.column_stack([x, y, np.zeros(side**2)])


def within(points, margin=0.15):
    return (np.abs(points[:, :2] - 0.5) < 0.5 - margin).all(1)


def test_cells_of_a_grid_reach_half_a_diagonal_however_the_grid_is_turned():
    expected = np.sqrt(0.5) / 30
    for angle in (0.0, 0.3, 0.7):
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        sheet = sheet_of(30) - [0.5, 0.5, 0]
        points, reaches = reaches_of(sheet @ turn.T)
        middle = np.hypot(points[:, 0], points[:, 1]) < 0.3
        # corners may lie between two of the sixteen directions, 11 degrees from the nearer
        assert (reaches[middle] <= expected * 1.001).all() and (reaches[middle] > 0.88 * expected).all()


def test_discs_as_wide_as_cells_and_a_tenth_leave_no_hole_in_a_random_sheet():
    rng = np.random.default_rng(0)
    points, reaches = reaches_of(np.column_stack([rng.random((2_000, 2)), np.zeros(2_000)]))
    reaches[reaches > 0.15] = 0  # at the border
    places = rng.uniform(0.15, 0.85, (4_000, 2))
    away = np.linalg.norm(places[:, None] - points[None, :, :2], axis=2)
    assert (away < 1.1 * reaches).any(1).all()
    assert not (away < 0.6 * reaches).any(1).all()


def test_a_border_leaves_cells_open_and_a_sheet_above_does_not_close_them():
    points, reaches = reaches_of(sheet_of(20))
    on_border = (points[:, :2] == 0).any(1) | (points[:, :2] > 0.945).any(1)
    assert (reaches[on_border] > 1).all() and (reaches[within(points)] < 0.05).all()
    above = np.concatenate([sheet_of(20), sheet_of(20) + np.float32([0, 0, 0.02])])  # nearer than the next point beside
    points, reaches = reaches_of(above)
    inner = within(points)
    np.testing.assert_allclose(reaches[inner], np.sqrt(0.5) / 20, rtol=0.13)


def test_cells_of_a_slope_are_measured_in_its_plane():
    sheet = sheet_of(30)
    normal = np.float32([-1, 0, 1]) / np.float32(np.sqrt(2))
    sheet[:, 2] = sheet[:, 0]
    points, reaches = reaches_of(sheet, lambda points: np.tile(normal, (len(points), 1)))
    np.testing.assert_allclose(reaches[within(points)], np.hypot(np.sqrt(2), 1) / 2 / 30, rtol=0.13)


def test_cells_in_space_end_at_what_lies_beyond_a_crease():
    floor = sheet_of(20)
    wall = np.column_stack([np.full(400, 0.975), floor[:, 1], -0.05 - floor[:, 0]])  # down from the floor's end on
    points, solid = reaches_of(np.concatenate([floor, wall]), solid=True)
    middle = (points[:, 2] == 0) & (np.abs(points[:, 1] - 0.5) < 0.3)
    edge, border = middle & (points[:, 0] == points[middle, 0].max()), middle & (points[:, 0] == 0)
    assert (solid[edge] < 1.5 / 20).all() and edge.sum() > 8
    assert (solid[border] > 3 / 20).all()


def test_only_those_asked_for_are_measured():
    points, reaches = reaches_of(sheet_of(20))
    grid, asked = native.NeighborGrid(np.float32(points)), np.array([7, 300, 12], np.int32)
    found, _ = grid.neighbors(asked, 24)
    normals = np.tile(UP, (len(points), 1))
    found_reaches, ends = native.voronoi_extent(grid.points, normals, asked, found)
    np.testing.assert_array_equal(found_reaches, reaches[asked])
    np.testing.assert_allclose(np.linalg.norm(ends - points[asked], axis=1), reaches[asked], rtol=1e-5)
    assert not ends[:, 2].any()


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.zeros((40, 3))])
def test_a_point_alone_or_many_in_one_place_have_no_border(points):
    assert np.isinf(reaches_of(points)[1]).all()
