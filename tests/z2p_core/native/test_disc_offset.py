"""Where flat discs lie: in a plane where their points do, on a sphere as far in as they would stand out."""

import numpy as np
import pytest

from z2p_core import native


def centres_of(points, normals_of, radius):
    grid = native.NeighborGrid(np.float32(points))
    found, _ = grid.neighbors(np.arange(len(points), dtype=np.int32), 16)
    radii = np.full(len(points), radius, np.float32)
    return grid.points, native.offset_disc_centers(grid.points, np.float32(normals_of(grid.points)), radii, found)


def outwards(points):
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("radius", "disc"), [(0.6, 0.03), (0.6, 0.05), (1.0, 0.06)])
def test_discs_of_a_sphere_lie_in_it_by_what_they_would_stand_out_on_average(radius, disc, sign):
    points = radius * outwards(np.random.default_rng(0).normal(size=(4000, 3)))
    points, centres = centres_of(points, lambda points: sign * outwards(points), disc)
    deep = radius - np.linalg.norm(centres, axis=1).mean()
    assert deep == pytest.approx(disc**2 / 4 / radius, rel=0.05)


def test_discs_of_a_plane_and_of_one_point_stay_where_they_are():
    rng = np.random.default_rng(0)
    sheet = np.column_stack([rng.random((500, 2)), np.zeros(500)])
    points, centres = centres_of(sheet, lambda points: np.tile([0, 0, 1], (len(points), 1)), 0.05)
    np.testing.assert_allclose(centres, points, atol=1e-7)
    points, centres = centres_of(np.ones((1, 3)), lambda points: np.tile([0, 0, 1], (1, 1)), 0.05)
    np.testing.assert_array_equal(centres, points)


def test_a_crease_moves_no_disc_far():
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.random((800, 2)), np.zeros(800)])
    wall = floor[:, [2, 1, 0]]
    points, centres = centres_of(
        np.concatenate([floor, wall]), lambda points: np.where(points[:, :1] > 0, [[0, 0, 1]], [[1, 0, 0]]), 0.05
    )
    moved = np.linalg.norm(centres - points, axis=1)
    assert moved.max() < 0.3 * 0.05 * 1.5 and (moved[points.max(1) > 0.5] > 0).mean() < 0.6
