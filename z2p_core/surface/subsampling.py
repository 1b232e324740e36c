"""A share of a cloud that does not depend on the order of its points, so that what is chosen by it does not, either."""

from __future__ import annotations

import numpy as np

HASH_MULTIPLIERS = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9))
"""Odd numbers of 64 bits, as those of xxHash, by which coordinates' bits become numbers as good as random."""
CHUNK_POINTS = 1 << 14
"""Points whose numbers are mixed at a time, in the processor's cache."""
PRESELECT_FROM, PRESELECT_FACTOR = 12, 4.0
"""Of clouds with so many times more points than wanted, so many times more than wanted are chosen first."""
SPARE_DEVIATIONS = 6.0
"""Standard deviations by which more points than wanted are looked at, so that hardly ever too few are found."""


def subsample_uniform(points: np.ndarray, most: int) -> np.ndarray:
    """At most `most` of points (N, 3), as if drawn at random, and in an order of their own.

    Both depend on the points' coordinates alone: a shuffled file gives the same share, number by number.
    """
    if len(points) > PRESELECT_FROM * most:
        some = points[_weak_hashes(points) < np.uint64(PRESELECT_FACTOR * most / len(points) * 2.0**64)]
        points = some if len(some) > most else points
    keys = _hashes(points)
    if len(points) > most:
        share = (most + SPARE_DEVIATIONS * most**0.5) / len(points)
        rows = np.flatnonzero(keys < np.uint64(share * 2.0**64)) if share < 0.5 else np.arange(len(points))
        if len(rows) < most:  # many points at one place share one number
            rows = np.arange(len(points))
        points, keys = points[rows], keys[rows]
    kept: np.ndarray = points[np.argsort(keys, kind="stable")[:most]]
    return kept


def prepend_canonical_point(points: np.ndarray) -> np.ndarray:
    """Points (N, 3) with one more before them, which is one of them, and the same one in whatever order they are.

    For what counts from its first point, and would round in another way from another one.
    """
    rows = np.flatnonzero(points[:, 0] == points[:, 0].min())
    least = rows[np.lexsort(points[rows].T[::-1])[0]]
    return np.concatenate([points[least : least + 1], points])


def _weak_hashes(points: np.ndarray) -> np.ndarray:
    """A number (N,) uint64 for each of points (N, 3), in a third of the time, and good enough to choose many by."""
    keys = np.empty(len(points), np.uint64)
    for start in range(0, len(points), CHUNK_POINTS):
        bits = (np.ascontiguousarray(points[start : start + CHUNK_POINTS].T, np.float64) + 0.0).view(np.uint64)
        x, y, z = (part * multiplier for part, multiplier in zip(bits, HASH_MULTIPLIERS, strict=True))
        keys[start : start + CHUNK_POINTS] = x + y + z
    return keys


def _hashes(points: np.ndarray) -> np.ndarray:
    """A number (N,) uint64 for each of points (N, 3), as good as random; equal points have the same."""
    keys = np.empty(len(points), np.uint64)
    for start in range(0, len(points), CHUNK_POINTS):
        some = points[start : start + CHUNK_POINTS].T.astype(np.float64)
        bits = np.ascontiguousarray(some + 0.0).view(np.uint64)  # -0.0 becomes 0.0
        mixed = bits[0] * HASH_MULTIPLIERS[0]
        for axis in (1, 2):
            mixed ^= mixed >> np.uint64(29)
            mixed ^= bits[axis]
            mixed *= HASH_MULTIPLIERS[axis]
        mixed ^= mixed >> np.uint64(32)
        mixed *= HASH_MULTIPLIERS[0]
        keys[start : start + CHUNK_POINTS] = mixed ^ mixed >> np.uint64(29)
    return keys
