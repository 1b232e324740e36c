"""Clip planes of discs on surfaces that are known: roofs, valleys, sheets and spheres."""

import numpy as np
import pytest
from point_shapes import sphere_of

from z2p_core import native

COUNT = 3_000


def spacing_of(slope):
    return (1.6**2 * np.hypot(1, slope) / COUNT) ** 0.5


def roof_of(slope):
    """Points (N, 3) of two planes that meet in the line x = z = 0, z = -slope |x|, and their upward normals."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-0.8, 0.8, (2, COUNT))
    normals = np.column_stack([slope * np.sign(x), np.zeros(COUNT), np.ones(COUNT)])
    points = np.column_stack([x, y, -slope * np.abs(x)])
    return points.astype(np.float32), (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


def clip_planes_of(points, normals, radius):
    grid = native.NeighborGrid(points)
    rows = ((grid.points[:, None] - points[None]) ** 2).sum(2).argmin(1)  # the grid sorts its points
    neighbors, _ = grid.neighbors(np.arange(len(points), dtype=np.int32), 16)
    radii = np.full(len(points), radius, np.float32)
    return grid.points, normals[rows], native.disc_clip_planes(grid.points, normals[rows], radii, neighbors)


def is_used(planes):
    return np.isfinite(planes[:, :, 3])


@pytest.mark.parametrize("slope", [0.6, 1.0, 2.0])
def test_ridges_clip_discs_for_normals_of_either_sign(slope):
    points, normals = roof_of(slope)
    spacing, radius = spacing_of(slope), 1.5 * spacing_of(slope)
    normals[::3] *= -1
    points, _, planes = clip_planes_of(points, normals, radius)
    distance = np.abs(points[:, 0]) * np.hypot(1, slope)
    near = (distance > 0.2 * spacing) & (distance < 0.6 * spacing)
    assert near.sum() > 10 and is_used(planes)[near, 0].mean() > 0.9
    assert (distance[is_used(planes)[:, 0]] < 2.5 * radius).all()
    first = planes[is_used(planes)[:, 0], 0]
    clipped = points[is_used(planes)[:, 0]]
    # the plane is that of the other side, raised by a margin, and the point itself lies below it
    side = -np.sign(clipped[:, 0])
    other = np.column_stack([slope * side, np.zeros(len(side)), np.ones(len(side))]) / np.hypot(1, slope)
    cosine = (other * first[:, :3]).sum(1)
    np.testing.assert_allclose(np.abs(cosine), 1, atol=1e-5)
    np.testing.assert_allclose(first[:, 3], 0.035 * radius, atol=1e-5)
    assert ((clipped * first[:, :3]).sum(1) < first[:, 3]).all()


@pytest.mark.parametrize("slope", [-2.0, -0.6, 0.0, 0.15])
def test_valleys_sheets_and_gentle_bends_clip_nothing(slope):
    _, _, planes = clip_planes_of(*roof_of(slope), 1.5 * spacing_of(slope))
    assert not is_used(planes).any()


@pytest.mark.slow
def test_only_a_coarsely_sampled_sphere_clips_discs():
    for count, expected in ((8_000, False), (60, True)):
        points = sphere_of(count)
        spacing = (4 * np.pi / count) ** 0.5
        assert is_used(clip_planes_of(points, points, 1.5 * spacing)[2]).any() == expected


def test_at_most_four_planes_nearest_first():
    points = sphere_of(40)
    points, normals, planes = clip_planes_of(points, points, 0.8)
    used = is_used(planes)
    assert used.sum(1).max() == 4 and (np.diff(used.astype(int), axis=1) <= 0).all()
    cosine = (planes[:, :, :3] * normals[:, None]).sum(2)
    distance = (planes[:, :, 3] - (planes[:, :, :3] * points[:, None]).sum(2) - 0.035 * 0.8) / np.sqrt(1 - cosine**2)
    assert (np.diff(np.where(used, distance, np.inf), axis=1)[used[:, 1:]] >= -1e-6).all()


def test_single_and_coincident_points_are_not_clipped():
    for points in (np.zeros((1, 3), np.float32), np.zeros((30, 3), np.float32)):
        normals = np.tile(np.float32([0, 0, 1]), (len(points), 1))
        assert not is_used(clip_planes_of(points, normals, 0.1)[2]).any()
