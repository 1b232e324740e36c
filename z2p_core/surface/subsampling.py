"""Subsampling that depends on the points' coordinates alone, so that shuffled clouds give the same points."""

from __future__ import annotations

import numpy as np

MAX_SURFACE_POINTS = 40_000
"""Points to which larger clouds are subsampled before their surface is estimated."""
RESUBSAMPLE_SALT = 0x297A2D39
"""Salt for `subsample_hashed` of what it has subsampled before; its multiples serve third, fourth, ... times."""
HASH_MULTIPLIERS = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9))
"""Odd 64-bit multipliers from xxHash, which mix the bits of coordinates."""
CHUNK_POINTS = 1 << 14
"""Points that are hashed at a time, so that intermediate arrays stay in the cache."""
PRESELECT_FROM = 12
"""Ratio of given to wanted points from which a cheaper hash preselects points."""
PRESELECT_FACTOR = 4.0
"""Points that are preselected, as a multiple of those wanted."""
SPARE_DEVIATIONS = 6.0
"""Standard deviations added to the expected number of selected points, so that hardly ever too few are selected."""


def subsample_uniform(points: np.ndarray, most: int) -> np.ndarray:
    """At most `most` of points (N, 3), as if drawn at random without replacement, sorted by their hashes.

    Selection and order depend on the coordinates alone: a shuffled cloud gives the same array.
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


def subsample_hashed(cloud: np.ndarray, most: int, salt: int = 0) -> np.ndarray:
    """About `most` points of a cloud (N, 3) float32 in its order, at most 1.5 as many, selected by a 32-bit hash.

    Faster than `subsample_uniform`, and not exact in number. A cloud of at most `most` points comes back as it is.
    To subsample a result again, give another `salt`: with the same one its points all have small hashes.
    """
    if len(cloud) <= most:
        return cloud
    bits = np.ascontiguousarray(cloud, dtype=np.float32).view(np.uint32)
    mixed = bits[:, 0] * np.uint32(0x9E3779B1) ^ bits[:, 1] * np.uint32(0x85EBCA77) ^ bits[:, 2] * np.uint32(0xC2B2AE3D)
    mixed = (mixed ^ mixed >> np.uint32(15) ^ np.uint32(salt)) * np.uint32(0x2C1B3C6D)
    kept: np.ndarray = cloud[mixed < np.uint32(min(most / len(cloud), 1.0) * 0xFFFFFFFF)]
    if 0 < len(kept) <= 1.5 * most:
        return kept
    distinct = np.unique(cloud, axis=0)  # points that coincide in float32 are kept or dropped together
    return distinct[:: -(-len(distinct) // most)]


def prepend_canonical_point(points: np.ndarray) -> np.ndarray:
    """Points (N, 3) with a copy of their lexicographically smallest one put before them: (N + 1, 3).

    For algorithms whose rounding depends on the first point, so that results do not depend on the points' order.
    """
    rows = np.flatnonzero(points[:, 0] == points[:, 0].min())
    least = rows[np.lexsort(points[rows].T[::-1])[0]]
    return np.concatenate([points[least : least + 1], points])


def _weak_hashes(points: np.ndarray) -> np.ndarray:
    """Hashes (N,) uint64 of points (N, 3) in a third of the time; good enough to preselect many points."""
    keys = np.empty(len(points), np.uint64)
    for start in range(0, len(points), CHUNK_POINTS):
        bits = (np.ascontiguousarray(points[start : start + CHUNK_POINTS].T, np.float64) + 0.0).view(np.uint64)
        x, y, z = (part * multiplier for part, multiplier in zip(bits, HASH_MULTIPLIERS, strict=True))
        keys[start : start + CHUNK_POINTS] = x + y + z
    return keys


def _hashes(points: np.ndarray) -> np.ndarray:
    """Well-mixed hashes (N,) uint64 of points (N, 3); equal points have equal hashes."""
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
