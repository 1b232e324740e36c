"""Normals, spacing and points of estimated surfaces: spheres, sheets, creases and noise, whose answers are known."""

import math

import numpy as np
import pytest
from point_shapes import sphere_of, square_of

from z2p_core import native
from z2p_core.surface.noise_level import MIN_NEIGHBORS
from z2p_core.surface.normals import estimate_surface, fit_local_patches
from z2p_core.surface.subsampling import subsample_hashed


def with_noise(cloud, scale, seed=7):
    return (cloud + np.random.default_rng(seed).normal(0, scale, cloud.shape)).astype(np.float32)


def angles_to_radii(points, normals):
    """Angles in degrees between normals and the radii of a sphere about the origin."""
    along = np.abs((points * normals).sum(1)) / np.linalg.norm(points, axis=1)
    return np.degrees(np.arccos(np.clip(along, 0, 1)))


def test_normals_of_a_sphere_are_its_radii():
    surface = estimate_surface(sphere_of(4000))
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-5)
    assert np.median(angles_to_radii(surface.points, surface.normals)) < 2
    assert np.quantile(angles_to_radii(surface.points, surface.normals), 0.99) < 8


def test_very_noisy_clouds_are_subsampled_and_more_accurate(monkeypatch):
    rng, cloud = np.random.default_rng(9), sphere_of(40_000)
    very_noisy, less_noisy = ((cloud * (1 + rng.normal(scale=scale, size=(40_000, 1)))).astype(np.float32)
                              for scale in (0.05, 0.01))  # fmt: skip
    subsampled = estimate_surface(very_noisy)
    assert 4_000 <= len(subsampled.points) <= 17_000 and len(estimate_surface(less_noisy).points) == 40_000
    monkeypatch.setattr("z2p_core.surface.normals.noise_exceeds_patch", lambda fit: False)
    full = estimate_surface(very_noisy)
    assert len(full.points) == 40_000
    errors = [np.abs(np.linalg.norm(surface.points, axis=1) - 1).mean() for surface in (subsampled, full)]
    angles = [angles_to_radii(surface.points, surface.normals).mean() for surface in (subsampled, full)]
    assert errors[0] < 0.6 * errors[1] and angles[0] < 0.8 * angles[1]


@pytest.mark.parametrize("count", [6_001, 16_400, 31_999, 60_000])
def test_subsampling_keeps_a_third_each_time_and_enough_points(monkeypatch, count):
    monkeypatch.setattr("z2p_core.surface.normals.noise_exceeds_patch", lambda fit: True)
    kept = len(estimate_surface(subsample_hashed(sphere_of(count), 40_000)).points)
    assert 1_850 < kept < 6_000
    times = math.log(min(count, 40_000) / kept, 3)
    assert abs(times - round(times)) < 0.07


def test_patches_follow_curvature_where_planes_do_not():
    cloud = sphere_of(1000)
    grid = native.NeighborGrid(cloud)
    neighbors, _ = grid.neighbors(np.arange(1000, dtype=np.int32), MIN_NEIGHBORS)
    plane_errors = angles_to_radii(grid.points, native.fit_planes(grid.points, neighbors)[0])
    surface = estimate_surface(cloud)
    assert np.median(angles_to_radii(surface.points, surface.normals)) < 0.4 * np.median(plane_errors)


@pytest.mark.parametrize("count", [16, 40])
def test_a_jet_is_exact_on_a_quadratic_surface(count):
    """The point lies above the surface, and the previous normal is off by some degrees."""
    rng = np.random.default_rng(5)
    flat = rng.uniform(-0.1, 0.1, (count, 2))
    flat[0] = 0
    points = np.column_stack([flat, 0.4 * flat[:, 0] ** 2 - 0.3 * flat[:, 0] * flat[:, 1]]).astype(np.float32)
    points[0, 2] += 0.01
    previous_normals = np.tile(np.float32([0.05, 0, 1]) / math.sqrt(1.0025), (count, 1)).astype(np.float32)
    neighbors, scale = np.arange(count, dtype=np.int32)[None], np.float32([0.1])
    normals, heights = native.fit_jets(points, previous_normals, np.int32([0]), neighbors, 10 * scale, scale)
    assert normals[0] == pytest.approx([0, 0, 1], abs=0.02)
    assert heights[0] == pytest.approx(0.01, abs=0.003)  # the point is one of its own neighbors


def refined(cloud, **changed):
    """Points and normals by the graph network, from the cloud's own fit or with some of its inputs replaced."""
    fit = fit_local_patches(cloud)
    inputs = {"points": fit.grid.points, "normals": fit.normals, "neighbors": fit.neighbors, "scale": fit.scale}
    return native.refine_normals(**inputs | changed, noise=fit.noise / fit.median_spacing)


def test_the_normal_network_is_rotation_equivariant():
    cloud = with_noise(sphere_of(1500), 0.02)
    fit = fit_local_patches(cloud)
    rotation = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0].astype(np.float32)
    points, normals = refined(cloud)
    rotated_points, rotated_normals = refined(cloud, points=fit.grid.points @ rotation, normals=fit.normals @ rotation)
    np.testing.assert_allclose(rotated_points, points @ rotation, atol=1e-5)
    np.testing.assert_allclose(rotated_normals, normals @ rotation, atol=1e-3)


def test_the_normal_network_ignores_the_sign_of_normals():
    cloud = with_noise(sphere_of(1500), 0.02)
    signs = np.random.default_rng(4).choice([-1, 1], (1500, 1)).astype(np.float32)
    points, normals = refined(cloud)
    same_points, signed = refined(cloud, normals=signs * fit_local_patches(cloud).normals)
    np.testing.assert_allclose(same_points, points, atol=1e-6)
    np.testing.assert_allclose(signed, signs * normals, atol=1e-4)


def box_of(count, seed=0):
    """Points (count, 3) on a unit cube, and its normals there (count, 3)."""
    rng = np.random.default_rng(seed)
    axis, side = rng.integers(3, size=count), rng.choice([-1, 1], count)
    points, normals = rng.uniform(-0.5, 0.5, (count, 3)), np.zeros((count, 3))
    points[np.arange(count), axis], normals[np.arange(count), axis] = 0.5 * side, side
    return points.astype(np.float32), normals


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_normal_network_improves_on_local_fits(noise):
    points, normals = box_of(3000)
    cloud = with_noise(points, noise)
    order = np.empty(len(cloud), int)
    fit, surface = fit_local_patches(cloud), estimate_surface(cloud)
    order[np.lexsort(fit.grid.points.T)] = np.lexsort(cloud.T)
    fit_error, network_error = (
        np.degrees(np.arccos(np.clip(np.abs((estimated * normals[order]).sum(1)), 0, 1))).mean()
        for estimated in (fit.normals, surface.normals)
    )
    assert network_error < 0.75 * fit_error


@pytest.mark.parametrize("count", [500, 4000, 30_000])
def test_spacing_is_the_side_of_a_points_share_of_the_surface(count):
    assert np.median(estimate_surface(sphere_of(count)).spacing) == pytest.approx(
        math.sqrt(4 * math.pi / count), rel=0.12
    )


def test_spacing_follows_density():
    dense, sparse = square_of(4000, 0.2, 0.0), square_of(1000, 0.2, 0.0, seed=1) + np.float32([1, 0, 0])
    surface = estimate_surface(np.concatenate([dense, sparse]))
    right = surface.points[:, 0] > 0.5
    assert np.median(surface.spacing[right]) / np.median(surface.spacing[~right]) == pytest.approx(2.0, rel=0.15)


def test_the_order_of_points_does_not_matter_and_none_is_lost():
    cloud = sphere_of(3000)
    first, second = estimate_surface(cloud), estimate_surface(cloud[::-1])
    for name in ("points", "spacing", "normals"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_array_equal(np.unique(native.NeighborGrid(cloud).points, axis=0), np.unique(cloud, axis=0))


def test_clean_curved_surfaces_keep_their_points():
    for count, radius in ((1000, 1.0), (6000, 1.0), (3000, 0.2)):
        cloud = sphere_of(count, radius=radius)
        surface = estimate_surface(cloud)
        assert surface.noise < 0.1 * np.median(surface.spacing)
        distances = np.linalg.norm(surface.points, axis=1)
        np.testing.assert_allclose(distances, radius, atol=0.02 * np.median(surface.spacing))


def test_noisy_points_are_moved_towards_their_surface():
    cloud = with_noise(sphere_of(6000), 0.02)
    surface = estimate_surface(cloud)
    before, after = (np.abs(np.linalg.norm(points, axis=1) - 1).mean() for points in (cloud, surface.points))
    assert after < 0.6 * before
    assert np.median(angles_to_radii(surface.points, surface.normals)) < 10


def test_a_crease_stays_sharp():
    rng = np.random.default_rng(3)
    ground = np.column_stack([rng.uniform(0, 1, (2500, 2)), np.zeros(2500)])
    wall = np.column_stack([np.zeros(2500), rng.uniform(0, 1, (2500, 2))])
    surface = estimate_surface(np.concatenate([ground, wall]))
    x, y, z = surface.points.T
    near_crease = (np.hypot(x, z) < 0.04) & (np.abs(y - 0.5) < 0.4)
    axis_aligned = np.abs(surface.normals[near_crease]).max(axis=1)  # 1 along an axis, 0.71 half way around the crease
    assert near_crease.sum() > 100 and np.median(axis_aligned) > 0.99 and np.quantile(axis_aligned, 0.2) > 0.95


def test_two_close_sheets_are_kept_apart():
    surface = estimate_surface(np.concatenate([square_of(3000, 0.5, 0.0), square_of(3000, 0.5, 0.05, seed=1)]))
    inside = np.abs(surface.points[:, :2]).max(axis=1) < 0.4  # at their rims, the other sheet is as near as their own
    assert np.quantile(np.abs(surface.normals[inside, 2]), 0.01) > 0.98


@pytest.mark.parametrize(
    "cloud",
    [
        np.zeros((1, 3)), np.zeros((50, 3)), np.linspace(0, 1, 50)[:, None] * [1, 0, 0], sphere_of(2), sphere_of(5),
        np.concatenate([sphere_of(500, radius=1e-3), [[100, 100, 100]]]), np.repeat(sphere_of(20), 30, axis=0),
        np.repeat(sphere_of(3), 500, axis=0),
    ],
    ids=["one point", "one place", "a line", "two", "five", "an outlier", "repeated points", "repeated often"],
)  # fmt: skip
def test_degenerate_clouds_have_finite_results(cloud):
    surface = estimate_surface(cloud.astype(np.float32))
    assert np.isfinite(surface.spacing).all() and (surface.spacing >= 0).all() and len(surface.points) == len(cloud)
    assert np.isfinite(surface.points).all() and np.isfinite(surface.noise)
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-4)
