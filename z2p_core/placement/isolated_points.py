"""Lone points strewn about a thing, as lidar has from birds, haze and echoes that came twice: no cluster tells them."""

from __future__ import annotations

import numpy as np

from z2p_core import native
from z2p_core.linalg import bounding_box
from z2p_core.surface.subsampling import subsample_uniform

FEWEST_POINTS, FEWEST_LONE = 500, 5
"""Points of a cloud that is looked at, and lone ones that are left out at least;
`z2p_core.placement.outliers` removes one or two."""
TAIL_SHARE, CORE_MARGIN = 0.04, 0.5
"""The core of a cloud along an axis is all but so many points at either end; what may be strewn lies farther from it
than so many of its widths."""
MOST_STREWN = 0.08
"""Share of all points that may be strewn; more are part of what was measured."""
LONE_DISTANCE, NEIGHBOURS = 7.0, 5
"""A point is lone whose neighbours are so many times as far away as is usual in the core."""
LEAST_SHRINKAGE = 0.3
"""Without them the cloud must be smaller by this share along an axis, or they do no harm."""
CORE_SAMPLE = 5_000
"""Points of a larger cloud that tell its core."""
NEIGHBOUR_SAMPLE = 60_000
"""Points of a larger cloud among which neighbours are looked for."""
FIRST_SAMPLE, FEW_LONE = 500, 0.2
"""Points that are asked first, and the share of lone ones from which on all are."""


def non_isolated_mask(points: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of finite points (N, 3): False for lone points far outside the core of the cloud.

    A mast or a pole is thin and high as well, but its points lie close to each other.
    """
    kept = np.ones(len(points), dtype=bool)
    if len(points) < FEWEST_POINTS:
        return kept
    outer = _outside_core(points)
    count = np.count_nonzero(outer)
    if not FEWEST_LONE <= count <= MOST_STREWN * len(points) or not _is_smaller_without(points, outer):
        return kept
    lone = _lone_among(points, outer)
    if np.count_nonzero(lone) >= FEWEST_LONE and _is_smaller_without(points, lone):
        kept[lone] = False
    return kept


def _outside_core(points: np.ndarray) -> np.ndarray:
    """Mask (N,) of the points that lie far beyond the core along an axis."""
    low, high = np.quantile(subsample_uniform(points, CORE_SAMPLE), [TAIL_SHARE, 1 - TAIL_SHARE], axis=0)
    width = CORE_MARGIN * (high - low)
    thin = width <= 1e-9 * float(width.max())  # a plane or a line has no core to be outside of
    width[thin] = np.inf
    least, most = bounding_box(points)
    if (least >= low - width).all() and (most <= high + width).all():
        return np.zeros(len(points), dtype=bool)
    outer: np.ndarray = ((points < low - width) | (points > high + width)).any(axis=1)
    return outer


def _is_smaller_without(points: np.ndarray, without: np.ndarray) -> bool:
    """Whether the cloud is clearly smaller along an axis without those points."""
    whole, rest = (np.subtract(*bounding_box(some)[::-1]) for some in (points, points[~without]))
    return bool((rest < (1 - LEAST_SHRINKAGE) * whole).any())


def _lone_among(points: np.ndarray, outer: np.ndarray) -> np.ndarray:
    """Mask (N,) of those outer points whose neighbours are far away."""
    low, high = bounding_box(points)
    placed = ((points - (low + high) / 2) / float((high - low).max())).astype(np.float32)
    grid = native.NeighborGrid(subsample_uniform(placed, NEIGHBOUR_SAMPLE))  # as sparse everywhere as it was
    core = subsample_uniform(placed[~outer], FIRST_SAMPLE)
    farthest = LONE_DISTANCE * float(np.median(_neighbour_distance(grid, core)))
    lone = np.zeros(len(points), dtype=bool)
    first = subsample_uniform(placed[outer], FIRST_SAMPLE)  # to look at all of them takes long
    if (_neighbour_distance(grid, first) > farthest).mean() > FEW_LONE:
        lone[outer] = _neighbour_distance(grid, placed[outer]) > farthest
    return lone


def _neighbour_distance(grid: native.NeighborGrid, places: np.ndarray) -> np.ndarray:
    """How far the farthest of the nearest points is from each of places (M, 3); inf for very far."""
    found = grid.neighbors_of_positions(places, NEIGHBOURS)
    farthest: np.ndarray = np.linalg.norm(grid.points[found] - places[:, None], axis=2).max(1)
    farthest[found[:, -1] == found[:, -2]] = np.inf  # it gives up where hardly anything is near
    return farthest
