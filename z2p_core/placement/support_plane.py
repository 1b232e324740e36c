"""Finds the table or floor that a depth camera's subject stands on."""

from __future__ import annotations

import math

import numpy as np

from z2p_core.interfaces import Sensor
from z2p_core.surface.subsampling import subsample_uniform

PLANE_CANDIDATES = 600
"""Number of planes through three random points that are tested (RANSAC)."""
MAX_PLANE_SAMPLE = 3000
"""Largest number of points that the planes are tested with."""
MIN_PLANE_SAMPLE = 200
"""Smallest number of points in which a plane is searched."""
MAX_TILT_DEGREES = 65.0
"""Largest angle between the support plane's normal and the camera's own up."""
PLANE_HALF_THICKNESS = 0.01
"""Largest distance of a plane's inliers, in the cloud's diagonal."""
MIN_STANDING_HEIGHT = 0.05
"""Smallest height above a plane of points that stand on it, in the cloud's diagonal."""
MIN_PLANE_SHARE = 0.25
"""Smallest share of the points on the support plane."""
MIN_STANDING_SHARE = 0.01
"""Smallest share of the points above the support plane."""
MAX_BELOW_SHARE = 0.03
"""Largest share of the points below the support plane."""


def support_plane_normal(points: np.ndarray, up: np.ndarray, sensor: Sensor) -> np.ndarray | None:
    """Unit normal (3,) of the table or floor that objects stand on in a depth camera's points (N, 3); None without one.

    `up` (3,) is the camera's own up, which is wrong by as much as it was tilted. The plane holds a quarter of the
    points, leans by less than 65 degrees from that, and nearly all else stands on its upper side, the camera too: the
    front of a box has all else behind it, and a wall leans too much.
    """
    sample = subsample_uniform(points, MAX_PLANE_SAMPLE)
    if len(sample) < MIN_PLANE_SAMPLE:
        return None
    size = float(np.linalg.norm(sample.max(0) - sample.min(0)))
    corner = np.random.default_rng(0).integers(0, len(sample), size=(PLANE_CANDIDATES, 3))  # same for all clouds
    first, second, third = (sample[corner[:, place]] for place in range(3))
    normals = np.cross(second - first, third - first)
    length = np.linalg.norm(normals, axis=1)
    fine = length > 1e-4 * size**2
    normals = normals[fine] / length[fine, None]
    normals *= np.where(normals @ up < 0, -1.0, 1.0)[:, None]
    seen = (normals * (sensor.position - first[fine])).sum(1) > 0
    likely = seen & (normals @ up > math.cos(math.radians(MAX_TILT_DEGREES)))
    normals, through = normals[likely], first[fine][likely]
    if len(normals) == 0:
        return None
    height = normals @ sample.T - (normals * through).sum(1)[:, None]
    within = np.abs(height) < PLANE_HALF_THICKNESS * size
    best = int(within.sum(1).argmax())
    below = (height[best] < -PLANE_HALF_THICKNESS * size).mean()
    above = (height[best] > MIN_STANDING_HEIGHT * size).mean()
    if within[best].mean() < MIN_PLANE_SHARE or above < MIN_STANDING_SHARE or below > MAX_BELOW_SHARE:
        return None
    inside = sample[within[best]]
    normal: np.ndarray = np.linalg.svd(inside - inside.mean(0), full_matrices=False)[2][2]
    return normal if normal @ up > 0 else -normal
