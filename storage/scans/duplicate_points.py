"""Rows of a cloud that tell nothing new: points given twice, and one place that stands for all that is missing."""

from __future__ import annotations

import math

import numpy as np

from z2p_core import native

FEW, FEW_SHARE = 10, 0.01
"""Rows that may repeat others, in number or as a share of all, before they are left out: so few show nowhere."""
FEWEST_MARKS, OFTENER, MANY = 20, 10, 0.02
"""A place marks what was not measured where it comes so often, and so many times as often as is usual in its cloud, and
is the origin or has that share of all rows."""
ODD = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9))
CHUNK = 1 << 14
"""Points whose numbers are mixed at a time, in the processor's cache."""

MOST_COMPARED = 300_000
"""Of more points nearly equal ones do no harm: they leave no gap between pixels."""
CROWDED = 0.1
"""Share of a cloud's points that find another one in their small cell, unless many are nearly equal."""
ASKED, COPIES = 256, 16
"""Points whose neighbours are looked at, and how many nearly equal ones each may have."""
APART, PAIRED = 20.0, 0.2
"""Copies count as such where the next point is so many times as far off, for that share of the points."""
SHIFTS = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5), (0.25, 0.75, 0.25), (0.75, 0.25, 0.75))
"""Of the cells' corners, in cells: copies that one cut parts share a cell in another."""


def distinct(points: np.ndarray) -> np.ndarray:
    """Points (N, 3) float64 without the rows that repeat another, or that stand for missing ones, in their order.

    Distances between points say how dense a cloud is: meshes whose corners come once for each triangle, and scans that
    were joined twice, would pass for clouds of no spacing at all. So would scans that were joined with a copy which
    differs in the last digits. Depth cameras write (0, 0, 0) for what they did not see, others -9999.
    """
    return _apart(_once(points))


def _once(points: np.ndarray) -> np.ndarray:
    """The points without rows that are equal to others, or marks."""
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


def _apart(points: np.ndarray) -> np.ndarray:
    """The points without rows that all but repeat an earlier one."""
    if not COPIES < len(points) <= MOST_COMPARED:
        return points
    low = points.min(axis=0)
    span = float((points.max(axis=0) - low).max())
    cell = 0.1 * span / math.sqrt(len(points))  # less than a tenth of the gaps between points of a surface
    if not cell > 0 or len(points) - len(_firsts((points - low) / cell)) <= max(FEW, CROWDED * len(points)):
        return points
    cell = _copies_apart(((points - low) / span).astype(np.float32)) * span
    for shift in SHIFTS if cell else ():
        kept: np.ndarray = points[np.sort(_firsts((points - low) / cell + shift))]
        points = kept
    return points


def _firsts(places: np.ndarray) -> np.ndarray:
    """The first row in each cell of side 1 that holds some of places (N, 3) >= 0, in no order."""
    return np.unique(_keys(np.floor(places)), return_index=True)[1]


def _copies_apart(cloud: np.ndarray) -> float:
    """A length between the distance of copies and that of other points in a cloud (N, 3) float32; 0 without copies."""
    grid = native.NeighborGrid(cloud)
    asked = np.linspace(0, len(cloud) - 1, min(ASKED, len(cloud))).astype(np.int32)
    found, _ = grid.neighbors(asked, COPIES + 2)
    away = np.linalg.norm(grid.points[found[:, 1:]] - grid.points[asked][:, None], axis=2)
    jump = away[:, 1:] / np.maximum(away[:, :-1], np.finfo(np.float32).eps)
    rows, last = np.arange(len(asked)), jump.argmax(axis=1)
    copied = jump[rows, last] > APART
    if copied.mean() < PAIRED:
        return 0.0
    near, far = (float(np.median(away[rows, last + step][copied])) for step in (0, 1))
    near = max(near, float(np.finfo(np.float32).eps))
    return min(math.sqrt(near * far), far / 3)
