"""Clouds made smooth, by patches wider than those that shade them.

A depth camera's noise is no chance from point to point: neighbouring pixels err alike, and a surface comes out
hammered. Wider patches even that out, at the price of true detail as small.
"""

from __future__ import annotations

import math

import numpy as np

from z2p_core import native
from z2p_core.surface.normals import RESUBSAMPLE_SALT, MAX_SURFACE_POINTS, noise_to_spacing, subsample_hashed, median_spacing

SMOOTH_NOISE_TO_SPACING = 0.2
"""Scatter of a depth camera's points, in spacings, from which on its clouds are made smooth."""
PATCH_RADIUS_SIGMAS, MAX_PATCH_RADIUS = 50.0, 0.1
"""Radius of the patches then: in standard deviations of the noise, and at most."""
PATCH_NEIGHBORS, MIN_PATCH_NEIGHBORS = 48, 12
"""Points that a patch is fitted to, spread over it, and without how many it is left alone."""
WINDOW_RADII, PLANE_TOLERANCE_RADII = 0.44, 0.17
"""In radii of a patch: how near its points count most, and how far off its plane."""
JET_ITERATIONS = 2
"""How often a patch is fitted, each time from the normal before, so that it keeps to its side of a crease."""
MAX_MOVE_MEDIANS = 2.5
"""How far a point is moved at most, in the median of all ways: what lies farther off its patch is no noise."""


def smoothing_radius(cloud: np.ndarray) -> float:
    """Radius of the patches that a depth camera's cloud (N, 3) asks for, in its units; 0 where it is clean."""
    noise = noise_to_spacing(cloud)
    return min(PATCH_RADIUS_SIGMAS * noise * median_spacing(cloud), MAX_PATCH_RADIUS) if noise >= SMOOTH_NOISE_TO_SPACING else 0.0


def smooth_cloud(cloud: np.ndarray, radius: float) -> np.ndarray:
    """The points (N, 3) float32 of a cloud, each moved onto a curved patch of that radius through those around it.

    Of larger clouds some 40,000 points are left, which stand for all. A patch must hold some points to smooth anything.
    """
    points = subsample_hashed(np.ascontiguousarray(cloud, np.float32), MAX_SURFACE_POINTS)
    held = math.pi * (radius / max(median_spacing(points), 1e-9)) ** 2
    count = int(min(held, len(points), PATCH_NEIGHBORS))
    if count < MIN_PATCH_NEIGHBORS:
        return points
    grid = native.NeighborGrid(subsample_hashed(points, max(round(len(points) * count / held), PATCH_NEIGHBORS), RESUBSAMPLE_SALT))
    places = np.concatenate([grid.points, points])
    found = grid.neighbors_of_positions(places, count)
    normals, _ = native.fit_planes(places, found)
    everyone = np.arange(len(places), dtype=np.int32)
    tolerance, window = (np.full(len(places), radii * radius, np.float32) for radii in (PLANE_TOLERANCE_RADII, WINDOW_RADII))
    for _ in range(JET_ITERATIONS):
        normals, heights = native.fit_jets(places, normals, everyone, found, tolerance, window)
    heights, normals = heights[-len(points) :], normals[-len(points) :]
    farthest = MAX_MOVE_MEDIANS * float(np.median(np.abs(heights)))
    moved: np.ndarray = points - np.clip(heights, -farthest, farthest)[:, None] * normals
    return moved
