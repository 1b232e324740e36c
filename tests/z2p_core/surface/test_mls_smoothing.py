"""Smoothed clouds come nearer to their surface, keep creases, and are the same in whatever order they come."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import box, sphere

from z2p_core.surface.mls_smoothing import MAX_PATCH_RADIUS, smooth_cloud, smoothing_radius
from z2p_core.surface.noise_level import NOISY_NOISE_TO_SPACING
from z2p_core.surface.subsampling import RESUBSAMPLE_SALT, subsample_hashed


def hammered(count: int, size: float = 0.01) -> np.ndarray:
    """A sphere with dents as wide as many points, and noise from point to point."""
    rng, points = np.random.default_rng(3), sphere(count)
    knots = np.random.default_rng(4).normal(size=(400, 3))
    knots /= np.linalg.norm(knots, axis=1, keepdims=True)
    dents = np.exp(600 * (points @ knots.T - 1)) @ rng.normal(size=400)
    return (points * (1 + size * dents + size * rng.normal(size=count))[:, None]).astype(np.float32)


def error(cloud: np.ndarray) -> float:
    return float(np.sqrt(((np.linalg.norm(cloud, axis=1) - 1) ** 2).mean()))


def test_dents_wider_than_many_points_are_evened_out() -> None:
    cloud = hammered(20_000)
    assert error(smooth_cloud(cloud, 0.25)) < 0.5 * error(cloud)
    assert error(smooth_cloud(cloud, 0.25)) < error(smooth_cloud(cloud, 0.1))


def test_points_move_across_the_surface_and_stay_where_they_are_along_it() -> None:
    cloud = hammered(20_000)
    moved = smooth_cloud(cloud, 0.1)
    outward = cloud / np.linalg.norm(cloud, axis=1, keepdims=True)
    way = moved - cloud
    along = way - (way * outward).sum(1, keepdims=True) * outward
    assert np.abs(along).mean() < 0.25 * np.abs(way).mean()


def test_the_edges_of_a_box_stay_sharp() -> None:
    cloud = box(20_000, 0.6, 0.5, 0.4).astype(np.float32)
    noisy = (cloud + np.random.default_rng(5).normal(scale=0.004, size=cloud.shape)).astype(np.float32)
    off = [np.abs(np.abs(points) - [0.6, 0.5, 0.4]).min(1) for points in (noisy, smooth_cloud(noisy, 0.12))]
    assert off[1].mean() < 0.5 * off[0].mean()
    assert np.quantile(off[1], 0.99) < 1.5 * np.quantile(off[0], 0.99)


def test_neither_order_nor_a_turn_matters() -> None:
    cloud = hammered(5_000)
    order = np.random.default_rng(6).permutation(len(cloud))
    np.testing.assert_allclose(smooth_cloud(cloud[order], 0.1), smooth_cloud(cloud, 0.1)[order], atol=1e-5)
    quarter = np.float32([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert error(smooth_cloud(cloud @ quarter, 0.1)) == pytest.approx(error(smooth_cloud(cloud, 0.1)), rel=0.1)


@pytest.mark.parametrize("count", [1, 3, 15, 40])
def test_patches_that_hold_too_few_points_change_nothing(count: int) -> None:
    cloud = hammered(count)
    assert np.array_equal(smooth_cloud(cloud, 0.1), cloud)


def test_points_far_from_all_others_are_no_trouble() -> None:
    cloud = np.vstack([hammered(20_000), np.float32([[40, 0, 0], [0, -60, 0]])])
    moved = smooth_cloud(cloud, 0.2)
    assert len(moved) == len(cloud) and np.isfinite(moved).all()
    assert np.linalg.norm(moved[-2:] - cloud[-2:], axis=1).max() < 0.1


def test_a_radius_is_asked_for_by_noisy_clouds_alone() -> None:
    assert smoothing_radius(sphere(5_000).astype(np.float32)) == 0
    rng = np.random.default_rng(7)
    noisy = (sphere(20_000) * (1 + 0.01 * rng.normal(size=(20_000, 1)))).astype(np.float32)
    assert 0 < smoothing_radius(noisy) <= MAX_PATCH_RADIUS
    few = (sphere(20_000) * (1 + 0.0005 * rng.normal(size=(20_000, 1)))).astype(np.float32)
    assert smoothing_radius(few) == 0 and NOISY_NOISE_TO_SPACING > 0


def test_what_was_thinned_is_thinned_again_by_another_salt() -> None:
    some = subsample_hashed(np.random.default_rng(0).normal(size=(90_000, 3)).astype(np.float32), 40_000)
    for most in (27_000, 20_000, 1_000):
        assert len(subsample_hashed(some, most, RESUBSAMPLE_SALT)) == pytest.approx(most, rel=0.1)
