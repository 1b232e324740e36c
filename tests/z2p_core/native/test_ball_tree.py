"""Kernels on balls, compared with all pairs of balls."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.native.balls import BallTree, nearest_balls, trace_from_balls


@pytest.fixture
def tree() -> BallTree:
    rng = np.random.default_rng(3)
    return BallTree.build(rng.uniform(-1, 1, (300, 3)).astype(np.float32), rng.uniform(0.01, 0.06, 300))


def distances(tree: BallTree) -> np.ndarray:
    """Distances (N, N) from each ball's center to each ball's surface."""
    centers, radii = tree.balls[:, :3], tree.balls[:, 3]
    return np.linalg.norm(centers[:, None] - centers, axis=2) - radii


def test_the_nearest_balls_are_those_of_all_pairs(tree: BallTree) -> None:
    nearest, limits = nearest_balls(tree, tree.everything, reach=8.0, room=6)
    gaps = distances(tree)
    np.fill_diagonal(gaps, np.inf)
    for ball in range(len(tree)):
        expected = [other for other in np.argsort(gaps[ball])[:6] if gaps[ball, other] < 8 * tree.balls[ball, 3]]
        assert nearest[ball][nearest[ball] >= 0].tolist() == expected
        assert (gaps[ball, expected] < limits[ball] + 1e-6).all()


def test_rays_hit_the_first_ball_in_their_way(tree: BallTree) -> None:
    rays = np.float32([[1, 0, 0], [0, -0.6, 0.8]])
    hits, lengths = trace_from_balls(tree, tree.everything, rays)
    for k, ray in enumerate(rays):
        offsets = tree.balls[None, :, :3] - tree.balls[:, None, :3]
        along = offsets @ ray
        chord_sq = tree.balls[None, :, 3] ** 2 - (offsets**2).sum(axis=2) + along**2
        is_hit = (chord_sq > 0) & (along > 0) & (distances(tree) > 0)
        length = np.where(is_hit, along - np.sqrt(np.abs(chord_sq)), np.inf)
        np.fill_diagonal(length, np.inf)
        found = np.isfinite(length.min(axis=1))
        assert (hits[~found, k] == -1).all()
        assert (hits[found, k] == length.argmin(axis=1)[found]).all()
        assert lengths[found, k] == pytest.approx(length.min(axis=1)[found], abs=1e-4)
    assert (hits >= 0).any()


def test_balls_nearer_than_a_limit_are_not_seen(tree: BallTree) -> None:
    rays = np.float32([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    limits = np.full(len(tree), 0.5, np.float32)
    hits, _ = trace_from_balls(tree, tree.everything, rays, limits)
    rows, columns = np.nonzero(hits >= 0)
    assert len(rows)
    assert (distances(tree)[rows, hits[rows, columns]] >= 0.5 - 1e-5).all()
