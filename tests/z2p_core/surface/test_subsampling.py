"""A share of a cloud depends on its points and not on their order."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.surface.subsampling import prepend_canonical_point, subsample_uniform

RNG = np.random.default_rng(0)


def shuffled(points: np.ndarray) -> np.ndarray:
    return points[RNG.permutation(len(points))]


@pytest.mark.parametrize("most", [1, 100, 4000, 4999, 5000, 9000])
def test_the_share_is_the_same_whatever_the_order(most: int) -> None:
    points = RNG.normal(size=(5000, 3))
    share = subsample_uniform(points, most)
    assert len(share) == min(most, len(points))
    assert np.array_equal(subsample_uniform(shuffled(points), most), share)
    assert {tuple(row) for row in share.tolist()} <= {tuple(row) for row in points.tolist()}


def test_the_share_is_even_over_sorted_and_regular_clouds() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(40.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for points in (grid, grid * 0.25, np.column_stack([np.arange(64000.0), np.zeros((64000, 2))])):
        share = subsample_uniform(points, 4000)
        np.testing.assert_allclose(share.mean(0), points.mean(0), atol=0.06 * np.ptp(points, axis=0).max())
        counts = np.histogram(share[:, 0], bins=4)[0]
        assert counts.min() > 800


def test_points_that_come_many_times_are_shared_all_the_same() -> None:
    points = np.repeat(RNG.normal(size=(7, 3)), 1000, axis=0)
    assert np.array_equal(subsample_uniform(points, 500), subsample_uniform(shuffled(points), 500))
    assert np.array_equal(subsample_uniform(np.array([[0.0, 0, 0]]), 5), subsample_uniform(np.array([[-0.0, 0, 0]]), 5))


def test_the_first_point_is_the_same_whatever_the_order() -> None:
    points = np.round(RNG.normal(size=(300, 3)))  # many share their x
    started = prepend_canonical_point(points)
    assert np.array_equal(started[1:], points)
    assert np.array_equal(prepend_canonical_point(shuffled(points))[0], started[0])
    assert (points == started[0]).all(1).any()
