"""Rows of a cloud that tell nothing new: points given twice, and one place that stands for all that is missing."""

from __future__ import annotations

import numpy as np

FEW, FEW_SHARE = 10, 0.01
"""Rows that may repeat others, in number or as a share of all, before they are left out: so few show nowhere."""
FEWEST_MARKS, OFTENER, MANY = 20, 10, 0.02
"""A place marks what was not measured where it comes so often, and so many times as often as is usual in its cloud, and
is the origin or has that share of all rows."""
ODD = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9))
CHUNK = 1 << 14
"""Points whose numbers are mixed at a time, in the processor's cache."""


def distinct(points: np.ndarray) -> np.ndarray:
    """Points (N, 3) float64 without the rows that repeat another, or that stand for missing ones, in their order.

    Distances between points say how dense a cloud is: meshes whose corners come once for each triangle, and scans that
    were joined twice, would pass for clouds of no spacing at all. Depth cameras write (0, 0, 0) for what they did not
    see, others -9999.
    """
    keys = _keys(points)
    ordered = np.sort(keys)
    repeats = np.count_nonzero(ordered[1:] == ordered[:-1])
    few = max(FEW, FEW_SHARE * len(points))
    if repeats < min(FEWEST_MARKS - 1, few):
        return points
    _, first, count = np.unique(keys, return_index=True, return_counts=True)
    often = count >= max(FEWEST_MARKS, OFTENER * float(np.median(count)))
    often &= (count >= MANY * len(points)) | ~points[first].any(axis=1)
    if often.any() and len(first) - np.count_nonzero(often) > FEWEST_MARKS:
        first = first[~often]
    elif repeats <= few:
        return points
    kept: np.ndarray = points[np.sort(first)]
    return kept


def _keys(points: np.ndarray) -> np.ndarray:
    """A number (N,) uint64 for each point (N, 3) float64; equal ones have the same, and others, but for chance, not."""
    keys = np.empty(len(points), np.uint64)
    for start in range(0, len(points), CHUNK):
        bits = np.ascontiguousarray(points[start : start + CHUNK].T + 0.0).view(np.uint64)  # -0.0 becomes 0.0
        mixed = bits[0] * ODD[0]
        for axis in (1, 2):
            mixed ^= mixed >> np.uint64(29)
            mixed ^= bits[axis]
            mixed *= ODD[axis]
        keys[start : start + CHUNK] = mixed
    return keys
