"""Whether a thing would stand on a side: what tells +Y up from +Z up where a format leaves it open."""

from __future__ import annotations

import numpy as np

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
DIRECTIONS = 16
"""That extreme points are looked for in, to leave most others out of a hull."""


def topples(points: np.ndarray, usual: np.ndarray, other: np.ndarray) -> bool:
    """Whether a thing of points (N, 3) would topple over with the unit vector `usual` up, and stand firmly on `other`.

    True only on strong evidence: most things that stand would stand on another side too.
    """
    points = points[:: -(-len(points) // MOST_POINTS)]
    if len(points) < FEWEST_POINTS:
        return False
    span = [float(np.ptp(points @ axis)) for axis in (usual, other)]
    if min(span) < LYING * float(np.ptp(points, axis=0).max()):
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
    height = points @ up
    low = float(np.quantile(height, 0.001))  # a stray or two must not hold it up
    across = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    across /= np.linalg.norm(across)
    flat = points @ np.column_stack([across, np.cross(up, across)])
    feet = hull(flat[height < low + SLAB * (height.max() - low)])
    footprint = area_of(hull(flat))
    if len(feet) < 3 or footprint <= 0:
        return -1.0, 0.0
    edge = np.roll(feet, -1, axis=0) - feet
    outward = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.linalg.norm(edge, axis=1, keepdims=True)
    beyond = float(((flat.mean(0) - feet) * outward).sum(1).max())
    return -beyond / footprint**0.5, area_of(feet) / footprint


def hull(points: np.ndarray) -> np.ndarray:
    """Corners (M, 2) of the convex hull of points (N, 2), counter-clockwise; Andrew's monotone chain."""
    ordered = np.unique(_outer(points), axis=0).tolist()

    def chain(row: list[list[float]]) -> list[list[float]]:
        kept: list[list[float]] = []
        for x, y in row:
            while len(kept) > 1:
                (ax, ay), (bx, by) = kept[-2:]
                if (bx - ax) * (y - by) - (by - ay) * (x - bx) > 0:
                    break
                kept.pop()
            kept.append([x, y])
        return kept

    return np.array(chain(ordered)[:-1] + chain(ordered[::-1])[:-1]).reshape(-1, 2)


def _outer(points: np.ndarray) -> np.ndarray:
    """Points (M, 2) of (N, 2), all that may be corners of the hull: not those well inside of extreme ones' polygon.

    The polygon is that of the farthest points in `DIRECTIONS` directions (after Akl and Toussaint, 1978).
    """
    if len(points) < 4 * DIRECTIONS or not np.ptp(points, axis=0).all():
        return points
    angle = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
    near = points - points[0]  # far from the origin, digits are few
    corners = near[(near @ np.stack([np.cos(angle), np.sin(angle)])).argmax(0)]
    corners = corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)]  # one may lie farthest in two directions
    edge = np.roll(corners, -1, axis=0) - corners
    normal = np.stack([-edge[:, 1], edge[:, 0]])  # to the left, which is inside
    beyond = near @ normal - (corners * normal.T).sum(1)
    slack = 1e-9 * np.ptp(points, axis=0).max() * np.abs(normal).max()
    outer: np.ndarray = points[(beyond <= slack).any(axis=1)]
    return outer


def area_of(corners: np.ndarray) -> float:
    """Area of a polygon (M, 2), counter-clockwise."""
    if len(corners) < 3:
        return 0.0
    x, y = corners.T
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
