"""Smoothing of depth-camera clouds by moving least squares on wide patches.

A depth camera's noise is correlated: neighboring pixels err alike, so a surface looks hammered. Patches wider than that
correlation even it out, at the price of true detail of the same size (Alexa et al., Computing and Rendering Point Set
Surfaces, 2003).
"""

from __future__ import annotations

import math

import numpy as np

from z2p_core import native
from z2p_core.surface.noise_level import NOISY_NOISE_TO_SPACING, median_spacing, noise_to_spacing
from z2p_core.surface.subsampling import MAX_SURFACE_POINTS, RESUBSAMPLE_SALT, subsample_hashed

PATCH_RADIUS_SIGMAS = 50.0
"""Radius of the patches, in standard deviations of the noise."""
MAX_PATCH_RADIUS = 0.1
"""Largest radius of the patches, in the cloud's units."""
PATCH_NEIGHBORS = 48
"""Points that a patch is fitted to, spread over it by subsampling."""
MIN_PATCH_NEIGHBORS = 12
"""Points that a patch must hold; with fewer the cloud stays as it is."""
WINDOW_RADII = 0.44
"""Standard deviation of the Gaussian window on the distance from the patch's center, in patch radii."""
PLANE_TOLERANCE_RADII = 0.17
"""Distance from the previous plane at which a neighbor's weight has fallen to a quarter, in patch radii."""
JET_ITERATIONS = 2
"""Times that a jet is fitted, each time weighted by the normal before, so that it keeps to its side of a crease."""
MAX_MOVE_MEDIANS = 2.5
"""Farthest that a point is moved, in medians of all distances; what lies farther off its patch is not noise."""


def smoothing_radius(cloud: np.ndarray) -> float:
    """Patch radius for a depth camera's cloud (N, 3), in its units; 0 if it is clean enough."""
    noise = noise_to_spacing(cloud)
    if noise < NOISY_NOISE_TO_SPACING:
        return 0.0
    return min(PATCH_RADIUS_SIGMAS * noise * median_spacing(cloud), MAX_PATCH_RADIUS)


def smooth_cloud(cloud: np.ndarray, radius: float) -> np.ndarray:
    """The points (N, 3) float32 of a cloud, each moved onto a curved patch of that radius fitted around it.

    Larger clouds are subsampled to about 40,000 points. The cloud stays as it is if patches hold fewer than 12 points.
    """
    points = subsample_hashed(np.ascontiguousarray(cloud, np.float32), MAX_SURFACE_POINTS)
    points_per_patch = math.pi * (radius / max(median_spacing(points), 1e-9)) ** 2
    count = int(min(points_per_patch, len(points), PATCH_NEIGHBORS))
    if count < MIN_PATCH_NEIGHBORS:
        return points
    sample_size = max(round(len(points) * count / points_per_patch), PATCH_NEIGHBORS)
    grid = native.NeighborGrid(subsample_hashed(points, sample_size, RESUBSAMPLE_SALT))
    positions = np.concatenate([grid.points, points])
    neighbors = grid.neighbors_of_positions(positions, count)
    normals, _ = native.fit_planes(positions, neighbors)
    all_indices = np.arange(len(positions), dtype=np.int32)
    tolerance = np.full(len(positions), PLANE_TOLERANCE_RADII * radius, np.float32)
    window = np.full(len(positions), WINDOW_RADII * radius, np.float32)
    for _ in range(JET_ITERATIONS):
        normals, heights = native.fit_jets(positions, normals, all_indices, neighbors, tolerance, window)
    heights, normals = heights[-len(points) :], normals[-len(points) :]
    farthest = MAX_MOVE_MEDIANS * float(np.median(np.abs(heights)))
    smoothed: np.ndarray = points - np.clip(heights, -farthest, farthest)[:, None] * normals
    return smoothed
