"""How z2p chose between +Z and +Y up before it looked at the whole shape: by what would topple over."""

from __future__ import annotations

import numpy as np

from z2p_core.linalg import along, extent, turned
from z2p_core.up_axis.support_polygon import area_of, hull, margin

SLAB = 0.03
"""Share of the height from below within which a point touches the ground."""
FIRM_MARGIN, FIRM_AREA = 0.08, 0.25
SHAKY_MARGIN, SHAKY_AREA = 0.03, 0.1
"""Firm: the centre lies well inside the feet's hull, which is large; shaky: at its edge or outside, and it is small.

Margins are in roots of the footprint's area, areas in shares of it.
"""
LYING = 0.3
"""A pose this low, in longest sides, is a thing lying down, which is always firm and tells nothing."""
MOST_POINTS, FEWEST_POINTS = 8000, 500


def topples(points: np.ndarray, usual: np.ndarray, other: np.ndarray) -> bool:
    """Whether a thing of points (N, 3) would topple over with the unit vector `usual` up, and stand firmly on `other`.

    True only on strong evidence: most things that stand would stand on another side too.
    """
    points = points[:: -(-len(points) // MOST_POINTS)]
    if len(points) < FEWEST_POINTS:
        return False
    span = [float(np.ptp(along(points, axis))) for axis in (usual, other)]
    low, high = extent(points)
    if min(span) < LYING * float((high - low).max()):
        return False
    margin, area = stance(points, other)
    if margin < FIRM_MARGIN or area < FIRM_AREA:
        return False
    margin, area = stance(points, usual)
    return margin < SHAKY_MARGIN and area < SHAKY_AREA


def stance(points: np.ndarray, up: np.ndarray) -> tuple[float, float]:
    """How far inside the hull of its feet the centre of points (N, 3) lies, and the area of that hull.

    Both are relative to the footprint, the hull of all points seen along `up` (3,). A thing on a point or a line gets
    (-1, 0).
    """
    height = along(points, up)
    low = float(np.quantile(height, 0.001))  # a stray or two must not hold it up
    across = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    across /= np.linalg.norm(across)
    flat = turned(points, np.stack([across, np.cross(up, across)]))
    feet = hull(flat[height < low + SLAB * (height.max() - low)])
    footprint = area_of(hull(flat))
    if len(feet) < 3 or footprint <= 0:
        return -1.0, 0.0
    return margin(flat.mean(0), feet) / footprint**0.5, area_of(feet) / footprint
