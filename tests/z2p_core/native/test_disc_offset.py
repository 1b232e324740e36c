"""Disc centers: unmoved on a plane, moved inwards on a sphere by the mean height."""

import numpy as np
import pytest

from z2p_core import native


def centers_of(points, normals_of, radius):
    grid = native.NeighborGrid(np.float32(points))
    neighbors, _ = grid.neighbors(np.arange(len(points), dtype=np.int32), 16)
    radii = np.full(len(points), radius, np.float32)
    return grid.points, native.offset_disc_centers(grid.points, np.float32(normals_of(grid.points)), radii, neighbors)


def outwards(points):
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("radius", "disc_radius"), [(0.6, 0.03), (0.6, 0.05), (1.0, 0.06)])
def test_centers_on_a_sphere_move_in_by_the_mean_height(radius, disc_radius, sign):
    points = radius * outwards(np.random.default_rng(0).normal(size=(4000, 3)))
    points, centers = centers_of(points, lambda points: sign * outwards(points), disc_radius)
    depth = radius - np.linalg.norm(centers, axis=1).mean()
    assert depth == pytest.approx(disc_radius**2 / 4 / radius, rel=0.05)


def test_centers_on_a_plane_and_of_one_point_stay():
    rng = np.random.default_rng(0)
    sheet = np.column_stack([rng.random((500, 2)), np.zeros(500)])
    points, centers = centers_of(sheet, lambda points: np.tile([0, 0, 1], (len(points), 1)), 0.05)
    np.testing.assert_allclose(centers, points, atol=1e-7)
    points, centers = centers_of(np.ones((1, 3)), lambda points: np.tile([0, 0, 1], (1, 1)), 0.05)
    np.testing.assert_array_equal(centers, points)


def test_a_crease_moves_centers_only_a_little():
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.random((800, 2)), np.zeros(800)])
    wall = floor[:, [2, 1, 0]]
    points, centers = centers_of(
        np.concatenate([floor, wall]), lambda points: np.where(points[:, :1] > 0, [[0, 0, 1]], [[1, 0, 0]]), 0.05
    )
    offsets = np.linalg.norm(centers - points, axis=1)
    assert offsets.max() < 0.3 * 0.05 * 1.5 and (offsets[points.max(1) > 0.5] > 0).mean() < 0.6
