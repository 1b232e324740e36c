"""Where a thing's feet are, seen from above: their hull, its area, and how far inside it the thing's middle lies."""

from __future__ import annotations

import numpy as np

HULL_DIRECTIONS = 64
"""In which a hull's corners are looked for: of a disc's hull, all but 0.2 % of its area."""


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Corners (M, 2) of the convex hull of points (N, 2), counter-clockwise: the farthest ones in `HULL_DIRECTIONS`."""
    if not len(points):
        return points
    angle = np.arange(HULL_DIRECTIONS) * (2 * np.pi / HULL_DIRECTIONS)
    near = np.ascontiguousarray((points - points[0]).T, np.float32)  # far from the origin, digits are few
    directions = np.column_stack([np.cos(angle), np.sin(angle)]).astype(np.float32)
    corners: np.ndarray = points[(directions @ near).argmax(1)]
    return corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)]  # one is the farthest in many directions


def polygon_area(corners: np.ndarray) -> float:
    """Area of a polygon (M, 2), counter-clockwise."""
    if len(corners) < 3:
        return 0.0
    x, y = corners.T
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def distance_inside(middle: np.ndarray, feet: np.ndarray) -> float:
    """How far inside a polygon (M, 2), M >= 3, counter-clockwise, a place (2,) lies; below 0 where it lies outside."""
    edge = np.roll(feet, -1, axis=0) - feet
    outward = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.linalg.norm(edge, axis=1, keepdims=True)
    return -float(((middle - feet) * outward).sum(1).max())
