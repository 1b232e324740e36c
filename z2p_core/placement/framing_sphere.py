"""The smallest sphere around very many points, from few passes over them."""

from __future__ import annotations

import numpy as np

from z2p_core.placement.bounding_sphere import Sphere, bounding_sphere

MIN_POINTS = 3_000_000
"""Smaller clouds are given to `bounding_sphere` as a whole, so that their pictures stay the same to the last bit."""
SAMPLE_POINTS = 5_000
"""Points of the first sphere."""
MAX_ADDED_POINTS = 20_000
"""Points outside a sphere that are added to those of the next one."""
TOLERANCE = 1e-9
"""How far outside the sphere a point may lie, in its radius."""
MAX_ROUNDS = 8
"""Rounds after which the sphere is computed from all points."""
CHUNK_POINTS = 1 << 14
"""Points whose distances are computed at a time: their coordinates fit the processor's cache."""


def framing_sphere(points: np.ndarray) -> Sphere:
    """The sphere that `bounding_sphere` finds around finite points (N, 3), N >= 1, up to rounding.

    The smallest sphere around some of the points is that of all if no other point lies outside of it; else those
    outside are added to the some.
    """
    if len(points) < MIN_POINTS:
        return bounding_sphere(points)
    chosen = points[
        np.unique(
            np.concatenate([[0], _extreme_rows(points), np.arange(0, len(points), -(-len(points) // SAMPLE_POINTS))])
        )
    ]
    for _ in range(MAX_ROUNDS):
        sphere = bounding_sphere(chosen)
        outside = _rows_outside(points, sphere)
        if not len(outside):
            return sphere
        chosen = np.concatenate([chosen, points[outside]])
    return bounding_sphere(points)


def _extreme_rows(points: np.ndarray) -> np.ndarray:
    """Rows (6,) of the smallest and largest coordinates along each axis: the unit in which spheres are computed."""
    rows = [which(points[:, axis]) for axis in range(3) for which in (np.argmin, np.argmax)]
    return np.array(rows, dtype=np.int64)


def _rows_outside(points: np.ndarray, sphere: Sphere) -> np.ndarray:
    """Rows (K,) of points (N, 3) outside a sphere, at most `MAX_ADDED_POINTS`: of more, the farthest."""
    centre, limit = np.array(sphere.centre), sphere.radius * (1 + TOLERANCE)
    rows, distances = [], []
    for start in range(0, len(points), CHUNK_POINTS):
        offset = points[start : start + CHUNK_POINTS] - centre
        squares = np.einsum("na,na->n", offset, offset)
        beyond = np.flatnonzero(squares > limit**2)
        if len(beyond):
            rows.append(beyond + start)
            distances.append(squares[beyond])
    if not rows:
        return np.empty(0, np.int64)
    found, far = np.concatenate(rows), np.concatenate(distances)
    if len(found) > MAX_ADDED_POINTS:
        found = found[np.argpartition(far, -MAX_ADDED_POINTS)[-MAX_ADDED_POINTS:]]
    return np.sort(found)
