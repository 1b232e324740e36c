"""Smoothed clouds are nearer to their surface, keep creases, and do not depend on the points' order."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import box, sphere

from z2p_core.surface.mls_smoothing import MAX_PATCH_RADIUS, smooth_cloud, smoothing_radius
from z2p_core.surface.noise_level import NOISY_NOISE_TO_SPACING


def dented_sphere(count: int, size: float = 0.01) -> np.ndarray:
    """A sphere with dents as wide as many points, and noise from point to point."""
    rng, points = np.random.default_rng(3), sphere(count)
    dent_centers = np.random.default_rng(4).normal(size=(400, 3))
    dent_centers /= np.linalg.norm(dent_centers, axis=1, keepdims=True)
    dents = np.exp(600 * (points @ dent_centers.T - 1)) @ rng.normal(size=400)
    return (points * (1 + size * dents + size * rng.normal(size=count))[:, None]).astype(np.float32)


def rms_radius_error(cloud: np.ndarray) -> float:
    return float(np.sqrt(((np.linalg.norm(cloud, axis=1) - 1) ** 2).mean()))


def test_dents_as_wide_as_many_points_are_smoothed_out() -> None:
    cloud = dented_sphere(20_000)
    assert rms_radius_error(smooth_cloud(cloud, 0.25)) < 0.5 * rms_radius_error(cloud)
    assert rms_radius_error(smooth_cloud(cloud, 0.25)) < rms_radius_error(smooth_cloud(cloud, 0.1))


def test_points_move_along_the_normal() -> None:
    cloud = dented_sphere(20_000)
    moved = smooth_cloud(cloud, 0.1)
    outward = cloud / np.linalg.norm(cloud, axis=1, keepdims=True)
    offsets = moved - cloud
    tangential = offsets - (offsets * outward).sum(1, keepdims=True) * outward
    assert np.abs(tangential).mean() < 0.25 * np.abs(offsets).mean()


def test_the_edges_of_a_box_stay_sharp() -> None:
    cloud = box(20_000, 0.6, 0.5, 0.4).astype(np.float32)
    noisy = (cloud + np.random.default_rng(5).normal(scale=0.004, size=cloud.shape)).astype(np.float32)
    distances = [np.abs(np.abs(points) - [0.6, 0.5, 0.4]).min(1) for points in (noisy, smooth_cloud(noisy, 0.12))]
    assert distances[1].mean() < 0.5 * distances[0].mean()
    assert np.quantile(distances[1], 0.99) < 1.5 * np.quantile(distances[0], 0.99)


def test_smoothing_ignores_order_and_rotation() -> None:
    cloud = dented_sphere(5_000)
    order = np.random.default_rng(6).permutation(len(cloud))
    np.testing.assert_allclose(smooth_cloud(cloud[order], 0.1), smooth_cloud(cloud, 0.1)[order], atol=1e-5)
    quarter_turn = np.float32([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    error, rotated_error = (rms_radius_error(smooth_cloud(points, 0.1)) for points in (cloud, cloud @ quarter_turn))
    assert rotated_error == pytest.approx(error, rel=0.1)


@pytest.mark.parametrize("count", [1, 3, 15, 40])
def test_patches_with_too_few_points_change_nothing(count: int) -> None:
    cloud = dented_sphere(count)
    assert np.array_equal(smooth_cloud(cloud, 0.1), cloud)


def test_far_outliers_stay_where_they_are() -> None:
    cloud = np.vstack([dented_sphere(20_000), np.float32([[40, 0, 0], [0, -60, 0]])])
    moved = smooth_cloud(cloud, 0.2)
    assert len(moved) == len(cloud) and np.isfinite(moved).all()
    assert np.linalg.norm(moved[-2:] - cloud[-2:], axis=1).max() < 0.1


def test_only_noisy_clouds_have_a_smoothing_radius() -> None:
    assert smoothing_radius(sphere(5_000).astype(np.float32)) == 0
    rng = np.random.default_rng(7)
    noisy = (sphere(20_000) * (1 + 0.01 * rng.normal(size=(20_000, 1)))).astype(np.float32)
    assert 0 < smoothing_radius(noisy) <= MAX_PATCH_RADIUS
    nearly_clean = (sphere(20_000) * (1 + 0.0005 * rng.normal(size=(20_000, 1)))).astype(np.float32)
    assert smoothing_radius(nearly_clean) == 0 and NOISY_NOISE_TO_SPACING > 0
