"""How z2p chose between +Z and +Y up before it looked at the whole shape: by what would topple over."""

from __future__ import annotations

import numpy as np

from z2p_core.linalg import dot_axis, bounding_box, rotate_points
from z2p_core.up_axis.support_polygon import polygon_area, convex_hull, distance_inside

GROUND_HEIGHT_SHARE = 0.03
"""Share of the height from below within which a point touches the ground."""
FIRM_MARGIN, FIRM_AREA = 0.08, 0.25
SHAKY_MARGIN, SHAKY_AREA = 0.03, 0.1
"""Firm: the centre lies well inside the feet's hull, which is large; shaky: at its edge or outside, and it is small.

Margins are in roots of the footprint's area, areas in shares of it.
"""
MIN_HEIGHT_SHARE = 0.3
"""Height, in the longest side, below which an object is lying down: it then always stands firmly."""
MAX_POINTS, MIN_POINTS = 8000, 500


def would_topple(points: np.ndarray, usual: np.ndarray, other: np.ndarray) -> bool:
    """Whether a thing of points (N, 3) would topple over with the unit vector `usual` up, and stand firmly on `other`.

    True only on strong evidence: most things that stand would stand on another side too.
    """
    points = points[:: -(-len(points) // MAX_POINTS)]
    if len(points) < MIN_POINTS:
        return False
    span = [float(np.ptp(dot_axis(points, axis))) for axis in (usual, other)]
    low, high = bounding_box(points)
    if min(span) < MIN_HEIGHT_SHARE * float((high - low).max()):
        return False
    margin, area = support_margin(points, other)
    if margin < FIRM_MARGIN or area < FIRM_AREA:
        return False
    margin, area = support_margin(points, usual)
    return margin < SHAKY_MARGIN and area < SHAKY_AREA


def support_margin(points: np.ndarray, up: np.ndarray) -> tuple[float, float]:
    """How far inside the hull of its feet the centre of points (N, 3) lies, and the area of that hull.

    Both are relative to the footprint, the hull of all points seen along `up` (3,). A thing on a point or a line gets
    (-1, 0).
    """
    height = dot_axis(points, up)
    low = float(np.quantile(height, 0.001))  # a stray or two must not hold it up
    across = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    across /= np.linalg.norm(across)
    flat = rotate_points(points, np.stack([across, np.cross(up, across)]))
    feet = convex_hull(flat[height < low + GROUND_HEIGHT_SHARE * (height.max() - low)])
    footprint = polygon_area(convex_hull(flat))
    if len(feet) < 3 or footprint <= 0:
        return -1.0, 0.0
    return distance_inside(flat.mean(0), feet) / footprint**0.5, polygon_area(feet) / footprint
