"""The previous rule to choose between +Z and +Y up: by the axis with which the object would topple over."""

from __future__ import annotations

import numpy as np

from z2p_core.linalg import bounding_box, dot_axis, rotate_points
from z2p_core.up_axis.support_polygon import convex_hull, distance_inside, polygon_area

GROUND_HEIGHT_SHARE = 0.03
"""Share of the height from below within which a point touches the ground."""
MIN_FIRM_MARGIN = 0.08
MIN_FIRM_AREA = 0.25
"""An object stands firmly if its centre lies this far inside the hull of its feet, and that hull is this large. Margins
are in roots of the footprint's area, areas are shares of it."""
MAX_SHAKY_MARGIN = 0.03
MAX_SHAKY_AREA = 0.1
"""Limits, in the same units, below which an object would topple over."""
MIN_HEIGHT_SHARE = 0.3
"""Height, as a share of the longest side, below which an object is lying down: it then always stands firmly."""
MAX_POINTS, MIN_POINTS = 8000, 500


def would_topple(points: np.ndarray, usual: np.ndarray, other: np.ndarray) -> bool:
    """Whether points (N, 3) would topple over with the unit vector `usual` up, and stand firmly with `other` up.

    True only on strong evidence: most objects that stand would stand on another side too.
    """
    points = points[:: -(-len(points) // MAX_POINTS)]
    if len(points) < MIN_POINTS:
        return False
    span = [float(np.ptp(dot_axis(points, axis))) for axis in (usual, other)]
    low, high = bounding_box(points)
    if min(span) < MIN_HEIGHT_SHARE * float((high - low).max()):
        return False
    margin, area = support_margin(points, other)
    if margin < MIN_FIRM_MARGIN or area < MIN_FIRM_AREA:
        return False
    margin, area = support_margin(points, usual)
    return margin < MAX_SHAKY_MARGIN and area < MAX_SHAKY_AREA


def support_margin(points: np.ndarray, up: np.ndarray) -> tuple[float, float]:
    """Distance of the centre of points (N, 3) inside the hull of its feet, and the area of that hull.

    Both are relative to the footprint, the hull of all points seen along `up` (3,). An object that
    stands on a point or a line gets (-1, 0).
    """
    height = dot_axis(points, up)
    low = float(np.quantile(height, 0.001))  # so that single outliers below do not count as the ground
    across = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    across /= np.linalg.norm(across)
    flat = rotate_points(points, np.stack([across, np.cross(up, across)]))
    feet = convex_hull(flat[height < low + GROUND_HEIGHT_SHARE * (height.max() - low)])
    footprint = polygon_area(convex_hull(flat))
    if len(feet) < 3 or footprint <= 0:
        return -1.0, 0.0
    return distance_inside(flat.mean(0), feet) / footprint**0.5, polygon_area(feet) / footprint
