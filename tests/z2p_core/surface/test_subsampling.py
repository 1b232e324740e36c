"""Subsampling depends on the points alone and not on their order, and keeps about as many as it should."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.surface.subsampling import RESUBSAMPLE_SALT, prepend_canonical_point, subsample_hashed, subsample_uniform

RNG = np.random.default_rng(0)


def shuffled(points: np.ndarray) -> np.ndarray:
    return points[RNG.permutation(len(points))]


@pytest.mark.parametrize("most", [1, 100, 4000, 4999, 5000, 9000])
def test_uniform_samples_do_not_depend_on_the_order(most: int) -> None:
    points = RNG.normal(size=(5000, 3))
    sample = subsample_uniform(points, most)
    assert len(sample) == min(most, len(points))
    assert np.array_equal(subsample_uniform(shuffled(points), most), sample)
    assert {tuple(row) for row in sample.tolist()} <= {tuple(row) for row in points.tolist()}


def test_uniform_samples_are_even_over_sorted_and_grid_clouds() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(40.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for points in (grid, grid * 0.25, np.column_stack([np.arange(64000.0), np.zeros((64000, 2))])):
        sample = subsample_uniform(points, 4000)
        np.testing.assert_allclose(sample.mean(0), points.mean(0), atol=0.06 * np.ptp(points, axis=0).max())
        counts = np.histogram(sample[:, 0], bins=4)[0]
        assert counts.min() > 800


def test_repeated_points_are_subsampled_in_a_fixed_order() -> None:
    points = np.repeat(RNG.normal(size=(7, 3)), 1000, axis=0)
    assert np.array_equal(subsample_uniform(points, 500), subsample_uniform(shuffled(points), 500))
    assert np.array_equal(subsample_uniform(np.array([[0.0, 0, 0]]), 5), subsample_uniform(np.array([[-0.0, 0, 0]]), 5))


def test_the_canonical_point_does_not_depend_on_the_order() -> None:
    points = np.round(RNG.normal(size=(300, 3)))  # many sample their x
    extended = prepend_canonical_point(points)
    assert np.array_equal(extended[1:], points)
    assert np.array_equal(prepend_canonical_point(shuffled(points))[0], extended[0])
    assert (points == extended[0]).all(1).any()


@pytest.mark.parametrize("seed", range(6))
def test_hashed_subsampling_of_coinciding_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(5, 3)).astype(np.float32)
    cloud = np.vstack([np.repeat(positions, 14_000, axis=0), rng.normal(size=(5, 3)).astype(np.float32)])
    assert 5 <= len(subsample_hashed(cloud, 40_000)) <= 60_000
    wide = rng.normal(size=(70_000, 3)).astype(np.float32)
    assert 0.9 * 40_000 < len(subsample_hashed(wide, 40_000)) < 1.1 * 40_000


def test_samples_are_subsampled_again_by_another_salt() -> None:
    sample = subsample_hashed(np.random.default_rng(0).normal(size=(90_000, 3)).astype(np.float32), 40_000)
    for most in (27_000, 20_000, 1_000):
        assert len(subsample_hashed(sample, most, RESUBSAMPLE_SALT)) == pytest.approx(most, rel=0.1)
