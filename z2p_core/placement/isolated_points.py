"""Isolated points around an object, as lidar records from birds, haze and double echoes; they form no cluster."""

from __future__ import annotations

import numpy as np

from z2p_core import native
from z2p_core.linalg import bounding_box
from z2p_core.surface.subsampling import subsample_uniform

MIN_POINTS = 500
"""Smaller clouds are not examined."""
MIN_ISOLATED_POINTS = 5
"""Fewer isolated points than these are left to `z2p_core.placement.outliers`."""
CORE_TAIL_SHARE = 0.04
"""Along each axis the core of a cloud is what lies between this share of the points at either end."""
CORE_MARGIN_WIDTHS = 0.5
"""Distance from the core, in its widths along an axis, beyond which a point may be isolated."""
MAX_OUTSIDE_SHARE = 0.08
"""Share of the points that may lie outside the core: more are part of the object."""
ISOLATION_RATIO = 7.0
"""A point is isolated if its neighbors are this many times as far away as is usual in the core."""
NEIGHBOR_COUNT = 5
"""Neighbors whose distance is compared."""
MIN_SHRINKAGE = 0.3
"""Removing the isolated points must shrink the cloud by this share along an axis; otherwise they do no harm."""
MAX_CORE_SAMPLE = 5_000
"""Points of a larger cloud from which its core is computed."""
MAX_NEIGHBOR_SAMPLE = 60_000
"""Points of a larger cloud among which neighbors are searched."""
PROBE_POINTS = 500
"""Points outside the core that are tested first."""
MIN_ISOLATED_PROBE_SHARE = 0.2
"""Share of isolated points among the tested ones above which all points outside the core are tested."""


def non_isolated_mask(points: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of finite points (N, 3): False for isolated points far outside the core of the cloud.

    A mast or a pole is thin and high as well, but its points lie close to each other.
    """
    kept = np.ones(len(points), dtype=bool)
    if len(points) < MIN_POINTS:
        return kept
    outer = _outside_core(points)
    count = np.count_nonzero(outer)
    if not MIN_ISOLATED_POINTS <= count <= MAX_OUTSIDE_SHARE * len(points) or not _is_smaller_without(points, outer):
        return kept
    isolated = _isolated_among(points, outer)
    if np.count_nonzero(isolated) >= MIN_ISOLATED_POINTS and _is_smaller_without(points, isolated):
        kept[isolated] = False
    return kept


def _outside_core(points: np.ndarray) -> np.ndarray:
    """Mask (N,) of the points that lie far beyond the core along an axis."""
    low, high = np.quantile(subsample_uniform(points, MAX_CORE_SAMPLE), [CORE_TAIL_SHARE, 1 - CORE_TAIL_SHARE], axis=0)
    width = CORE_MARGIN_WIDTHS * (high - low)
    thin = width <= 1e-9 * float(width.max())  # a plane or a line has no core to be outside of
    width[thin] = np.inf
    least, most = bounding_box(points)
    if (least >= low - width).all() and (most <= high + width).all():
        return np.zeros(len(points), dtype=bool)
    outer: np.ndarray = ((points < low - width) | (points > high + width)).any(axis=1)
    return outer


def _is_smaller_without(points: np.ndarray, without: np.ndarray) -> bool:
    """Whether the cloud is clearly smaller along an axis without the points of that mask."""
    whole, rest = (np.subtract(*bounding_box(some)[::-1]) for some in (points, points[~without]))
    return bool((rest < (1 - MIN_SHRINKAGE) * whole).any())


def _isolated_among(points: np.ndarray, outer: np.ndarray) -> np.ndarray:
    """Mask (N,) of those outer points whose neighbors are far away."""
    low, high = bounding_box(points)
    placed = ((points - (low + high) / 2) / float((high - low).max())).astype(np.float32)
    grid = native.NeighborGrid(subsample_uniform(placed, MAX_NEIGHBOR_SAMPLE))  # keeps relative density
    core = subsample_uniform(placed[~outer], PROBE_POINTS)
    threshold = ISOLATION_RATIO * float(np.median(_neighbor_distance(grid, core)))
    isolated = np.zeros(len(points), dtype=bool)
    first = subsample_uniform(placed[outer], PROBE_POINTS)  # testing all of them takes long
    if (_neighbor_distance(grid, first) > threshold).mean() > MIN_ISOLATED_PROBE_SHARE:
        isolated[outer] = _neighbor_distance(grid, placed[outer]) > threshold
    return isolated


def _neighbor_distance(grid: native.NeighborGrid, positions: np.ndarray) -> np.ndarray:
    """Distance (M,) from positions (M, 3) to the farthest of their nearest points; inf if too few are near."""
    neighbors = grid.neighbors_of_positions(positions, NEIGHBOR_COUNT)
    farthest: np.ndarray = np.linalg.norm(grid.points[neighbors] - positions[:, None], axis=2).max(1)
    farthest[neighbors[:, -1] == neighbors[:, -2]] = np.inf  # the grid repeats the last one if too few points are near
    return farthest
