"""Tangent planes of spheres, sheets, creases and noise, whose answers are known."""

import math

import numpy as np
import pytest
from point_shapes import sphere_of, square_of

from z2p_core import native
from z2p_core.surface.noise_level import (
    MAX_NEIGHBORS,
    MIN_NEIGHBORS,
    neighbor_count,
    noise_to_spacing,
    probe_indices,
    residual_noise,
)
from z2p_core.surface.normals import estimate_surface, fit_local_patches
from z2p_core.surface.subsampling import subsample_hashed


def noisy(cloud, scale, seed=7):
    return (cloud + np.random.default_rng(seed).normal(0, scale, cloud.shape)).astype(np.float32)


def off_radius(points, normals):
    """Angles in degrees between normals and the radii of a sphere about the origin."""
    along = np.abs((points * normals).sum(1)) / np.linalg.norm(points, axis=1)
    return np.degrees(np.arccos(np.clip(along, 0, 1)))


def test_normals_of_a_sphere_are_its_radii():
    found = estimate_surface(sphere_of(4000))
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1, atol=1e-5)
    assert np.median(off_radius(found.points, found.normals)) < 2
    assert np.quantile(off_radius(found.points, found.normals), 0.99) < 8


@pytest.mark.parametrize("count", [1, 16, 64])
def test_neighbours_in_a_crowd_are_the_nearest_each_once(count):
    """Thousands in one cell, and points that come three times: nearest first, and of those as far the first ones."""
    rng = np.random.default_rng(2)
    crowd = 1e-3 * rng.random((3000, 3))
    grid = native.NeighborGrid(np.concatenate([rng.random((500, 3)), crowd, crowd[:50], crowd[:50]]).astype(np.float32))
    asked = np.flatnonzero((grid.points < 1e-3).all(1)).astype(np.int32)[::7]
    found, _ = grid.neighbors(asked, count)
    away = ((grid.points[asked][:, None] - grid.points) ** 2).sum(2)
    expected = np.argsort(away, axis=1, kind="stable")[:, :count]
    np.testing.assert_allclose(
        np.take_along_axis(away, found, 1), np.take_along_axis(away, expected, 1), rtol=1e-4, atol=1e-12
    )
    assert all(len(set(row)) == count for row in found.tolist())


def test_neighbours_of_other_places_are_the_nearest_and_one_at_least():
    rng = np.random.default_rng(8)
    grid, places = native.NeighborGrid(sphere_of(2000)), 1.01 * sphere_of(300)
    away = np.sort(((places[:, None] - grid.points) ** 2).sum(2), axis=1)
    found = grid.neighbors_of_positions(places, 20)
    np.testing.assert_allclose(((places[:, None] - grid.points[found]) ** 2).sum(2)[:, :4], away[:, :4], rtol=1e-3)
    few = native.NeighborGrid(np.float32([[0, 0, 0], *(0.01 * rng.random((100, 3)) + 1)]))
    assert set(few.neighbors_of_positions(np.float32([[0.3, 0.5, 0.4], [90, 0, 0], [-1, -1, -1]]), 8).ravel()) <= set(
        range(101)
    )


def test_of_a_cloud_that_drowns_in_noise_fewer_points_tell_the_surface_better(monkeypatch):
    rng, cloud = np.random.default_rng(9), sphere_of(40_000)
    drowning, clear = ((cloud * (1 + rng.normal(scale=scale, size=(40_000, 1)))).astype(np.float32)
                       for scale in (0.05, 0.01))  # fmt: skip
    found = estimate_surface(drowning)
    assert 4_000 <= len(found.points) <= 17_000 and len(estimate_surface(clear).points) == 40_000
    monkeypatch.setattr("z2p_core.surface.normals.noise_exceeds_patch", lambda own: False)
    everyone = estimate_surface(drowning)
    assert len(everyone.points) == 40_000
    off, off_before = (np.abs(np.linalg.norm(one.points, axis=1) - 1).mean() for one in (found, everyone))
    assert off < 0.6 * off_before
    assert off_radius(found.points, found.normals).mean() < 0.8 * off_radius(everyone.points, everyone.normals).mean()


def test_patches_follow_curvature_where_planes_do_not():
    cloud = sphere_of(1000)
    grid = native.NeighborGrid(cloud)
    found, _ = grid.neighbors(np.arange(1000, dtype=np.int32), MIN_NEIGHBORS)
    flat = off_radius(grid.points, native.fit_planes(grid.points, found)[0])
    fine = estimate_surface(cloud)
    assert np.median(off_radius(fine.points, fine.normals)) < 0.4 * np.median(flat)


@pytest.mark.parametrize("count", [16, 40])
def test_a_jet_is_exact_on_a_surface_of_its_own_order(count):
    """A bowl, seen from a point above it, its first normal off by some degrees."""
    rng = np.random.default_rng(5)
    flat = rng.uniform(-0.1, 0.1, (count, 2))
    flat[0] = 0
    points = np.column_stack([flat, 0.4 * flat[:, 0] ** 2 - 0.3 * flat[:, 0] * flat[:, 1]]).astype(np.float32)
    points[0, 2] += 0.01
    before = np.tile(np.float32([0.05, 0, 1]) / math.sqrt(1.0025), (count, 1)).astype(np.float32)
    everyone, wide = np.arange(count, dtype=np.int32)[None], np.float32([0.1])
    normals, heights = native.fit_jets(points, before, np.int32([0]), everyone, 10 * wide, wide)
    assert normals[0] == pytest.approx([0, 0, 1], abs=0.02)
    assert heights[0] == pytest.approx(0.01, abs=0.003)  # it is one of its own neighbours


def refined(cloud, **changed):
    """Points and normals by the graph network, from the cloud's own fit or with some of its inputs replaced."""
    own = fit_local_patches(cloud)
    given = {
        "points": own.grid.points,
        "normals": own.normals,
        "neighbors": own.neighbors,
        "scale": own.scale,
    } | changed
    return native.refine_normals(**given, noise=own.noise / own.median_spacing)


def test_neighbours_agree_upon_the_same_however_the_cloud_is_turned():
    cloud = noisy(sphere_of(1500), 0.02)
    own = fit_local_patches(cloud)
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    turn = turn.astype(np.float32)
    points, normals = refined(cloud)
    turned_points, turned_normals = refined(cloud, points=own.grid.points @ turn, normals=own.normals @ turn)
    np.testing.assert_allclose(turned_points, points @ turn, atol=1e-5)
    np.testing.assert_allclose(turned_normals, normals @ turn, atol=1e-3)


def test_neighbours_agree_upon_the_same_whatever_the_sign_of_their_normals():
    cloud = noisy(sphere_of(1500), 0.02)
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
def test_agreement_finds_creases_and_flat_sides_better_than_each_point_by_itself(noise):
    points, normals = box_of(3000)
    cloud = noisy(points, noise)
    order = np.empty(len(cloud), int)
    own, agreed = fit_local_patches(cloud), estimate_surface(cloud)
    order[np.lexsort(own.grid.points.T)] = np.lexsort(cloud.T)
    alone, together = (
        np.degrees(np.arccos(np.clip(np.abs((found * normals[order]).sum(1)), 0, 1))).mean()
        for found in (own.normals, agreed.normals)
    )
    assert together < 0.75 * alone


@pytest.mark.parametrize("count", [500, 4000, 30_000])
def test_spacing_is_the_side_of_a_points_share_of_the_surface(count):
    assert np.median(estimate_surface(sphere_of(count)).spacing) == pytest.approx(
        math.sqrt(4 * math.pi / count), rel=0.12
    )


def test_spacing_follows_density():
    dense, sparse = square_of(4000, 0.2, 0.0), square_of(1000, 0.2, 0.0, seed=1) + np.float32([1, 0, 0])
    found = estimate_surface(np.concatenate([dense, sparse]))
    right = found.points[:, 0] > 0.5
    assert np.median(found.spacing[right]) / np.median(found.spacing[~right]) == pytest.approx(2.0, rel=0.15)


def test_the_order_of_points_does_not_matter_and_none_is_lost():
    cloud = sphere_of(3000)
    first, second = estimate_surface(cloud), estimate_surface(cloud[::-1])
    for name in ("points", "spacing", "normals"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_array_equal(np.unique(native.NeighborGrid(cloud).points, axis=0), np.unique(cloud, axis=0))


@pytest.mark.parametrize("scale", [0.0025, 0.005, 0.01, 0.02])
def test_noise_is_measured(scale):
    assert estimate_surface(noisy(sphere_of(6000), scale)).noise == pytest.approx(scale, rel=0.25)


def test_a_clean_surface_however_curved_has_hardly_any_noise_and_stays_where_it_is():
    for count, radius in ((1000, 1.0), (6000, 1.0), (3000, 0.2)):
        cloud = sphere_of(count, radius=radius)
        found = estimate_surface(cloud)
        assert found.noise < 0.1 * np.median(found.spacing)
        np.testing.assert_allclose(np.linalg.norm(found.points, axis=1), radius, atol=0.02 * np.median(found.spacing))


def test_noise_asks_for_more_neighbours():
    asked = [neighbor_count(noise) for noise in (0.0, 0.2, 0.4, 5.0)]
    assert asked[0] == MIN_NEIGHBORS and asked[-1] == MAX_NEIGHBORS and asked == sorted(set(asked))


def test_noisy_points_are_moved_towards_their_surface_and_face_as_it_does():
    cloud = noisy(sphere_of(6000), 0.02)
    found = estimate_surface(cloud)
    before, after = (np.abs(np.linalg.norm(x, axis=1) - 1).mean() for x in (cloud, found.points))
    assert after < 0.6 * before
    assert np.median(off_radius(found.points, found.normals)) < 10


def test_a_crease_stays_sharp():
    rng = np.random.default_rng(3)
    flat = np.column_stack([rng.uniform(0, 1, (2500, 2)), np.zeros(2500)])
    wall = np.column_stack([np.zeros(2500), rng.uniform(0, 1, (2500, 2))])
    found = estimate_surface(np.concatenate([flat, wall]))
    near = (np.hypot(found.points[:, 0], found.points[:, 2]) < 0.04) & (np.abs(found.points[:, 1] - 0.5) < 0.4)
    straight = np.abs(found.normals[near]).max(axis=1)  # 1 along an axis, 0.71 half way round the crease
    assert near.sum() > 100 and np.median(straight) > 0.99 and np.quantile(straight, 0.2) > 0.95


def test_two_close_sheets_are_kept_apart():
    found = estimate_surface(np.concatenate([square_of(3000, 0.5, 0.0), square_of(3000, 0.5, 0.05, seed=1)]))
    inside = np.abs(found.points[:, :2]).max(axis=1) < 0.4  # at their rims, the other sheet is as near as their own
    assert np.quantile(np.abs(found.normals[inside, 2]), 0.01) > 0.98


@pytest.mark.parametrize(
    "cloud",
    [
        np.zeros((1, 3)), np.zeros((50, 3)), np.linspace(0, 1, 50)[:, None] * [1, 0, 0], sphere_of(2), sphere_of(5),
        np.concatenate([sphere_of(500, radius=1e-3), [[100, 100, 100]]]), np.repeat(sphere_of(20), 30, axis=0),
        np.repeat(sphere_of(3), 500, axis=0),
    ],
    ids=["one point", "one place", "a line", "two", "five", "a stray point", "repeated points", "repeated often"],
)  # fmt: skip
def test_degenerate_clouds_have_finite_answers(cloud):
    found = estimate_surface(cloud.astype(np.float32))
    assert np.isfinite(found.spacing).all() and (found.spacing >= 0).all() and len(found.points) == len(cloud)
    assert np.isfinite(found.points).all() and np.isfinite(found.noise)
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1, atol=1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_thinning_keeps_its_word_where_points_coincide_in_float32(seed):
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(5, 3)).astype(np.float32)
    cloud = np.vstack([np.repeat(places, 14_000, axis=0), rng.normal(size=(5, 3)).astype(np.float32)])
    assert 5 <= len(subsample_hashed(cloud, 40_000)) <= 60_000
    wide = rng.normal(size=(70_000, 3)).astype(np.float32)
    assert 0.9 * 40_000 < len(subsample_hashed(wide, 40_000)) < 1.1 * 40_000


def plate(count: int, thick: float, seed: int = 0) -> np.ndarray:
    """Both sides of a square plate, its thickness in spacings of either side."""
    rng = np.random.default_rng(seed)
    sides = np.where(rng.random(count) < 0.5, thick * math.sqrt(2 / count), 0.0)
    return np.column_stack([rng.random((count, 2)), sides]).astype(np.float32)


@pytest.mark.parametrize("thick", [0.7, 1.0, 1.5])
def test_the_other_side_of_a_plate_is_no_noise(thick):
    cloud = plate(3000, thick)
    grid = native.NeighborGrid(cloud)
    asked = np.arange(0, 3000, 7, dtype=np.int32)
    found, spacing = grid.neighbors(asked, MIN_NEIGHBORS)
    typical = float(np.median(spacing))
    assert residual_noise(grid.points, found) > 0.1 * typical or thick == 1.5  # what planes alone say
    assert noise_to_spacing(cloud) < 0.06


@pytest.mark.parametrize("sigma", [0.1, 0.25])
def test_noise_is_told_of_a_sheet_and_of_a_plate(sigma):
    rng = np.random.default_rng(4)
    sheet = np.column_stack([rng.random((4000, 2)), sigma / math.sqrt(4000) * rng.normal(size=4000)])
    assert noise_to_spacing(sheet.astype(np.float32)) == pytest.approx(sigma, rel=0.25)
    noisy = plate(4000, 3.0) + sigma / math.sqrt(2000) * rng.normal(size=(4000, 3)).astype(np.float32)
    assert noise_to_spacing(noisy) == pytest.approx(sigma, rel=0.45)


@pytest.mark.parametrize("sigma", [0.1, 0.2])
@pytest.mark.parametrize("thick", [1.5, 1.8, 2.0])
def test_noise_of_a_plate_is_told_where_planes_tell_none(sigma, thick):
    """Its other side comes in among the further neighbours, which planes take for curvature."""
    rng = np.random.default_rng(4)
    cloud = plate(4000, thick) + sigma / math.sqrt(2000) * rng.normal(size=(4000, 3)).astype(np.float32)
    grid = native.NeighborGrid(cloud)
    found, _ = grid.neighbors(probe_indices(4000), MIN_NEIGHBORS)
    assert residual_noise(grid.points, found) == 0
    assert noise_to_spacing(cloud) == pytest.approx(sigma, rel=0.25)


def test_a_depth_cameras_steps_are_noise():
    """Pixels of a slanted wall, whose depths come in steps as large as their distance."""
    x, y = np.meshgrid(np.arange(60.0), np.arange(60.0))
    steps = np.round(0.37 * x + 0.21 * y)
    assert noise_to_spacing(np.column_stack([x.ravel(), y.ravel(), steps.ravel()]).astype(np.float32)) > 0.15


def test_a_slab_holds_half_of_the_points_and_leaves_out_the_rest():
    """Nine points within 0.02 of a tilted plane, seven far from it."""
    rng = np.random.default_rng(6)
    flat = np.column_stack([rng.uniform(-1, 1, (16, 2)), rng.uniform(-0.02, 0.02, 16)])
    flat[9:, 2] = rng.uniform(3, 4, 7)
    flat[0] = 0
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = (flat @ turned).astype(np.float32)
    rows = np.concatenate([[0], 1 + np.argsort((flat[1:, :2] ** 2).sum(1))]).astype(np.int32)[None]
    widths, steep = native.fit_thin_slabs(points, np.zeros(1, np.int32), rows, 9)
    assert 0.005 < widths[0] < 0.06
    assert steep[0] == pytest.approx(7 / 16)
