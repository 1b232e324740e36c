"""Ray casting against discs, compared with a test of every disc."""

from __future__ import annotations

import math

import numpy as np
import pytest
from point_shapes import sphere_of, square_of

from z2p_core import native

UP = np.float32([0, 0, 1])
COUNT = 3000


def unit(rays: np.ndarray) -> np.ndarray:
    return (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).astype(np.float32)


def all_indices(points: np.ndarray) -> np.ndarray:
    return np.arange(len(points), dtype=np.int32)


def test_rays_hit_the_nearest_sheet_where_they_cross_it() -> None:
    """Three sheets one above the other; rays go up and to the side."""
    heights, spacing = (-0.5, 0.0, 0.6), 0.8 / math.sqrt(COUNT)
    points = np.concatenate([square_of(COUNT, 0.4, height, seed) for seed, height in enumerate(heights)])
    rays = np.tile(unit(np.float32([0.3, 0.1, 1])), (3 * COUNT, 1))
    hits = native.raycast_discs(points, np.tile(UP, (3 * COUNT, 1)), all_indices(points), rays, spacing, spacing, 1.0)
    assert hits.dtype == np.int32 and (hits[2 * COUNT :] == -1).all(), "nothing lies over the last sheet"
    for number, height in enumerate(heights[1:]):
        own = slice(number * COUNT, (number + 1) * COUNT)
        crossing = points[own] + rays[own] * (height - points[own, 2:]) / rays[own, 2:]
        inside, hit = (np.abs(crossing[:, :2]) < 0.37).all(1), hits[own]
        assert (hit[inside] // COUNT == number + 1).mean() > 0.95  # a sheet of random points has a gap here and there
        seen = hit // COUNT == number + 1
        assert np.linalg.norm(points[hit[seen]] - crossing[seen], axis=1).max() <= spacing
        outside = (np.abs(crossing[:, :2]) > 0.4 + spacing).any(1)
        assert not seen[outside].any()


@pytest.mark.parametrize("spread", [1.0, 0.3])
def test_grid_traversal_equals_testing_every_disc(spread: float) -> None:
    rng, disc_radius = np.random.default_rng(0), 0.07
    points = (spread * rng.uniform(-1, 1, (400, 3)) / math.sqrt(3)).astype(np.float32)
    normals, rays = unit(rng.normal(size=(400, 3))), unit(rng.normal(size=(400, 3)))
    query_indices = rng.permutation(400)[:150].astype(np.int32)
    hits = native.raycast_discs(points, normals, query_indices, rays[query_indices], disc_radius, 0.01, 1.0)
    expected = np.full(len(query_indices), -1)
    for row, point in enumerate(query_indices):
        step, ray, normal = points - points[point], rays[point], normals[point]
        along, n_dot_ray, slope = step @ ray, normals @ ray, float(ray @ normal)
        distance = np.where(np.abs(n_dot_ray) < 0.15, along, np.einsum("na,na->n", step, normals) / n_dot_ray)
        miss, height = np.linalg.norm(step - distance[:, None] * ray, axis=1), step @ normal
        own = height > 0.5 * along * slope if slope < 0 else height < 0.5 * along * slope
        is_hit = (along > 0.032) & (distance > 0) & (miss < disc_radius) & ~own
        if is_hit.any():
            expected[row] = np.argmin(np.where(is_hit, distance, np.inf))
    assert 15 < (expected >= 0).sum() < 145
    np.testing.assert_array_equal(hits, expected)


def test_rays_of_a_sphere_hit_its_far_side_only_inwards() -> None:
    points, spacing = sphere_of(COUNT, radius=0.8), math.sqrt(4 * math.pi * 0.64 / COUNT)
    normals, rows = points / 0.8, all_indices(points)
    outwards = native.raycast_discs(points, normals, rows, normals, 1.3 * spacing, spacing, 0.85)
    inwards = native.raycast_discs(points, normals, rows, -normals, 1.3 * spacing, spacing, 0.85)
    assert (outwards == -1).all() and (inwards >= 0).mean() > 0.97
    seen = inwards >= 0
    assert np.linalg.norm(points[inwards[seen]] + points[seen], axis=1).max() < 1.5 * spacing


@pytest.mark.parametrize("radius", [1.0, 1e-3, 50.0])
def test_rays_end_for_any_scale_axis_zero_or_nan(radius: float) -> None:
    points = radius * sphere_of(50, radius=0.9)
    for ray in (UP, -UP, np.float32([1, 0, 0]), np.float32([0, 0, 0]), np.float32([np.nan, 0, 1])):
        queries, rays = all_indices(points), np.tile(ray, (50, 1))
        hits = native.raycast_discs(points, points / radius, queries, rays, 1e-3, 1e-3, radius)
        assert ((hits >= -1) & (hits < 50)).all()


def test_no_queried_points_give_no_hits() -> None:
    points = sphere_of(10)
    hits = native.raycast_discs(points, points, np.empty(0, np.int32), np.empty((0, 3)), 0.1, 0.1, 1.0)
    assert hits.shape == (0,)
