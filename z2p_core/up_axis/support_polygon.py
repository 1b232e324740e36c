"""The support polygon of an object, the convex hull of its feet seen from above, and its stability margin."""

from __future__ import annotations

import numpy as np

HULL_DIRECTIONS = 64
"""Directions in which the farthest point is a corner of the hull; a disc's hull gets all but 0.2 % of its area."""


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Corners (M, 2) of the convex hull of points (N, 2), counter-clockwise: the farthest ones in `HULL_DIRECTIONS`."""
    if not len(points):
        return points
    angle = np.arange(HULL_DIRECTIONS) * (2 * np.pi / HULL_DIRECTIONS)
    near = np.ascontiguousarray((points - points[0]).T, np.float32)  # float32 is coarse far from the origin
    directions = np.column_stack([np.cos(angle), np.sin(angle)]).astype(np.float32)
    corners: np.ndarray = points[(directions @ near).argmax(1)]
    return corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)]  # without repeats


def polygon_area(corners: np.ndarray) -> float:
    """Area of a polygon (M, 2), counter-clockwise."""
    if len(corners) < 3:
        return 0.0
    x, y = corners.T
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def distance_inside(middle: np.ndarray, feet: np.ndarray) -> float:
    """Distance of a position (2,) from the nearest edge of a convex polygon (M, 2), counter-clockwise; below 0 outside.

    The polygon has at least three corners.
    """
    edge = np.roll(feet, -1, axis=0) - feet
    outward = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.linalg.norm(edge, axis=1, keepdims=True)
    return -float(((middle - feet) * outward).sum(1).max())
