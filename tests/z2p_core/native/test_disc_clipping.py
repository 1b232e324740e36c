"""Where discs end: on roofs, in valleys, on sheets and at outlines, whose surfaces are known."""

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


def clips_of(points, normals, radius):
    grid = native.NeighborGrid(points)
    rows = ((grid.points[:, None] - points[None]) ** 2).sum(2).argmin(1)  # the grid has an order of its own
    found, _ = grid.neighbors(np.arange(len(points), dtype=np.int32), 16)
    radii = np.full(len(points), radius, np.float32)
    return grid.points, normals[rows], native.disc_clip_planes(grid.points, normals[rows], radii, found)


def ended(clips):
    return np.isfinite(clips[:, :, 3])


@pytest.mark.parametrize("slope", [0.6, 1.0, 2.0])
def test_discs_beside_a_ridge_end_at_it_whichever_way_their_normals_point(slope):
    points, normals = roof_of(slope)
    spacing, radius = spacing_of(slope), 1.5 * spacing_of(slope)
    normals[::3] *= -1
    points, _, clips = clips_of(points, normals, radius)
    away = np.abs(points[:, 0]) * np.hypot(1, slope)
    near = (away > 0.2 * spacing) & (away < 0.6 * spacing)
    assert near.sum() > 10 and ended(clips)[near, 0].mean() > 0.9
    assert (away[ended(clips)[:, 0]] < 2.5 * radius).all()
    first = clips[ended(clips)[:, 0], 0]
    beside = points[ended(clips)[:, 0]]
    # the plane that ends a disc is the other side's, shifted by a little room, and the point itself lies under it
    side = -np.sign(beside[:, 0])
    other = np.column_stack([slope * side, np.zeros(len(side)), np.ones(len(side))]) / np.hypot(1, slope)
    cosine = (other * first[:, :3]).sum(1)
    np.testing.assert_allclose(np.abs(cosine), 1, atol=1e-5)
    np.testing.assert_allclose(first[:, 3], 0.035 * radius, atol=1e-5)
    assert ((beside * first[:, :3]).sum(1) < first[:, 3]).all()


@pytest.mark.parametrize("slope", [-2.0, -0.6, 0.0, 0.15])
def test_discs_go_on_in_valleys_on_sheets_and_over_gentle_bends(slope):
    _, _, clips = clips_of(*roof_of(slope), 1.5 * spacing_of(slope))
    assert not ended(clips).any()


def test_a_finely_sampled_sphere_ends_no_disc_and_a_coarse_one_does():
    for count, some in ((8_000, False), (60, True)):
        points = sphere_of(count)
        spacing = (4 * np.pi / count) ** 0.5
        assert ended(clips_of(points, points, 1.5 * spacing)[2]).any() == some


def test_the_nearest_ends_come_first_and_there_are_four_at_most():
    points = sphere_of(40)
    points, normals, clips = clips_of(points, points, 0.8)
    kept = ended(clips)
    assert kept.sum(1).max() == 4 and (np.diff(kept.astype(int), axis=1) <= 0).all()
    along = (clips[:, :, :3] * normals[:, None]).sum(2)
    away = (clips[:, :, 3] - (clips[:, :, :3] * points[:, None]).sum(2) - 0.035 * 0.8) / np.sqrt(1 - along**2)
    assert (np.diff(np.where(kept, away, np.inf), axis=1)[kept[:, 1:]] >= -1e-6).all()


def test_a_cloud_of_one_point_or_of_equal_points_is_fine():
    for points in (np.zeros((1, 3), np.float32), np.zeros((30, 3), np.float32)):
        normals = np.tile(np.float32([0, 0, 1]), (len(points), 1))
        assert not ended(clips_of(points, normals, 0.1)[2]).any()
