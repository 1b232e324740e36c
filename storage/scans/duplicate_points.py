"""Rows of a cloud that carry no new measurement: duplicate points, and a fill value that stands for missing points."""

from __future__ import annotations

import math

import numpy as np

from z2p_core import native

TOLERATED_DUPLICATES, TOLERATED_DUPLICATE_SHARE = 10, 0.01
"""Duplicates up to this number, or this share of all rows, may stay: so few are invisible in a picture."""
MIN_FILL_ROWS = 20
"""A repeated point is a fill value (it stands for missing measurements) only if it comes at least this many times."""
FILL_TO_MEDIAN_ROWS = 10
"""A fill value also comes at least this many times as often as the median point of its cloud."""
MIN_FILL_SHARE = 0.02
"""A fill value other than the origin also makes up at least this share of all rows."""
HASH_MULTIPLIERS = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9))
"""Odd 64-bit multipliers, one for each coordinate."""
HASH_BLOCK_POINTS = 1 << 14
"""Points that are hashed at a time, so that the block stays in the processor's cache."""

MAX_NEAR_DUPLICATE_POINTS = 300_000
"""Larger clouds keep their near duplicates: there they leave no gap between pixels."""
CROWDED_SHARE = 0.1
"""Near duplicates are looked for only if more than this share of the points has another point in its small cell."""
PROBE_POINTS, MAX_COPIES = 256, 16
"""Points whose neighbors are examined, and how many near duplicates each of them may have."""
MIN_GAP_RATIO = 20.0
"""A point has near duplicates if the next neighbor is at least this many times as far away as they are."""
MIN_COPIED_SHARE = 0.2
"""A cloud has near duplicates if at least this share of the examined points has some."""
GRID_SHIFTS = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5), (0.25, 0.75, 0.25), (0.75, 0.25, 0.75))
"""Offsets of the grid, in cells: near duplicates that one grid separates share a cell of another."""


def drop_duplicates(points: np.ndarray) -> np.ndarray:
    """Removes duplicates, near duplicates and fill values from points (N, 3) float64; the order is kept.

    The distances between points measure the density of a cloud. Meshes that list a corner once for each triangle, and
    scans that were joined twice, would otherwise have a spacing of zero; so would scans that were joined with a copy
    that differs in the last digits. Depth cameras write (0, 0, 0) for pixels without a measurement, others -9999.

    Returns:
        `points` itself where nothing is removed, otherwise a new array (M, 3).
    """
    return _drop_near_duplicates(_drop_exact_duplicates(points))


def _drop_exact_duplicates(points: np.ndarray) -> np.ndarray:
    """Removes rows that equal an earlier one, and all rows that are a fill value."""
    keys = _hash_rows(points)
    ordered = np.sort(keys)
    repeats = np.count_nonzero(ordered[1:] == ordered[:-1])
    tolerated = max(TOLERATED_DUPLICATES, TOLERATED_DUPLICATE_SHARE * len(points))
    if repeats < min(MIN_FILL_ROWS - 1, tolerated):
        return points
    _, first, count = np.unique(keys, return_index=True, return_counts=True)
    is_fill = count >= max(MIN_FILL_ROWS, FILL_TO_MEDIAN_ROWS * float(np.median(count)))
    is_fill &= (count >= MIN_FILL_SHARE * len(points)) | ~points[first].any(axis=1)
    if is_fill.any() and len(first) - np.count_nonzero(is_fill) > MIN_FILL_ROWS:
        first = first[~is_fill]
    elif repeats <= tolerated:
        return points
    kept: np.ndarray = points[np.sort(first)]
    return kept


def _hash_rows(points: np.ndarray) -> np.ndarray:
    """A hash (N,) uint64 of each row of points (N, 3) float64; 0.0 and -0.0 have the same."""
    keys = np.empty(len(points), np.uint64)
    for start in range(0, len(points), HASH_BLOCK_POINTS):
        bits = np.ascontiguousarray(points[start : start + HASH_BLOCK_POINTS].T + 0.0).view(np.uint64)  # -0.0 -> 0.0
        mixed = bits[0] * HASH_MULTIPLIERS[0]
        for axis in (1, 2):
            mixed ^= mixed >> np.uint64(29)
            mixed ^= bits[axis]
            mixed *= HASH_MULTIPLIERS[axis]
        keys[start : start + HASH_BLOCK_POINTS] = mixed
    return keys


def _drop_near_duplicates(points: np.ndarray) -> np.ndarray:
    """Removes rows that differ from an earlier one by far less than the spacing of the cloud."""
    if not MAX_COPIES < len(points) <= MAX_NEAR_DUPLICATE_POINTS:
        return points
    low = points.min(axis=0)
    span = float((points.max(axis=0) - low).max())
    cell = 0.1 * span / math.sqrt(len(points))  # less than a tenth of the gaps between points of a surface
    if not cell > 0:
        return points
    shared = len(points) - len(_first_row_per_cell((points - low) / cell))
    if shared <= max(TOLERATED_DUPLICATES, CROWDED_SHARE * len(points)):
        return points
    cell = _near_duplicate_distance(((points - low) / span).astype(np.float32)) * span
    for shift in GRID_SHIFTS if cell else ():
        kept: np.ndarray = points[np.sort(_first_row_per_cell((points - low) / cell + shift))]
        points = kept
    return points


def _first_row_per_cell(coordinates: np.ndarray) -> np.ndarray:
    """The index of the first row in each occupied unit cell of coordinates (N, 3) >= 0, in no particular order."""
    return np.unique(_hash_rows(np.floor(coordinates)), return_index=True)[1]


def _near_duplicate_distance(cloud: np.ndarray) -> float:
    """A distance that separates near duplicates from other neighbors in a cloud (N, 3) float32; 0 without any."""
    grid = native.NeighborGrid(cloud)
    queries = np.linspace(0, len(cloud) - 1, min(PROBE_POINTS, len(cloud))).astype(np.int32)
    neighbors, _ = grid.neighbors(queries, MAX_COPIES + 2)
    distances = np.linalg.norm(grid.points[neighbors[:, 1:]] - grid.points[queries][:, None], axis=2)
    gap_ratios = distances[:, 1:] / np.maximum(distances[:, :-1], np.finfo(np.float32).eps)
    rows, last_copy = np.arange(len(queries)), gap_ratios.argmax(axis=1)
    has_copies = gap_ratios[rows, last_copy] > MIN_GAP_RATIO
    if has_copies.mean() < MIN_COPIED_SHARE:
        return 0.0
    near, far = (float(np.median(distances[rows, last_copy + step][has_copies])) for step in (0, 1))
    near = max(near, float(np.finfo(np.float32).eps))
    return min(math.sqrt(near * far), far / 3)
