"""Spacing and noise of a bare cloud: how far points lie apart, and how far off their surface.

Noise is the standard deviation of points off planes through their neighbors, with the part removed that a curved
surface adds. Where several sheets of surface lie close together (a thin plate, bars), planes cannot distinguish them
from noise; there the thinnest slab that holds just over half of the neighbors measures it (after Rousseeuw, Least
Median of Squares Regression, 1984).
"""

from __future__ import annotations

import math

import numpy as np

from z2p_core import native
from z2p_core.surface.subsampling import MAX_SURFACE_POINTS, subsample_hashed

NOISY_NOISE_TO_SPACING = 0.2
"""Noise of a cloud, in spacings of its points, from which on it counts as noisy. Measured: up to 0.16 (5,000 points
with noise of 0.005 of the bounding sphere's radius) weights for clean clouds are as good overall and better on the
object; from 0.3 on those for noisy clouds are better. Depth cameras' clouds are smoothed from the same value on."""
MIN_NEIGHBORS = 16
"""Neighbors that planes and patches of a clean cloud are fitted to."""
MAX_NEIGHBORS = 64
"""Neighbors that they are fitted to in the noisiest clouds."""
NEIGHBORS_PER_NOISE = 75.0
"""Neighbors added for noise as large as the spacing."""
NOISE_PROBES = 400
"""Points at which noise is measured, about."""
LEAST_MEDIAN_SLABS = ((8, 5, 0.211), (16, 9, 0.567))
"""(neighbors, how many of them a slab holds, half width of the slab by noise of a seventh of the spacing)."""
SLAB_NOISE_LIMIT = 0.2
"""Noise, in spacings, up to which slabs measure it: their width hardly grows with larger noise."""
SLAB_NOISE_CAP = 1.6
"""Largest result, as a multiple of the slabs' answer, for larger noise where several sheets lie close together."""
MULTI_SHEET_SHARE = 0.06
"""Share of neighbors above or below a point, rather than beside it, from which several sheets are assumed."""


def noise_to_spacing(cloud: np.ndarray) -> float:
    """Standard deviation of a cloud's points (N, 3) off their surface, in spacings; 0 for fewer than 16 points."""
    if len(cloud) < MIN_NEIGHBORS:
        return 0.0
    grid = native.NeighborGrid(subsample_hashed(cloud, MAX_SURFACE_POINTS))
    query_indices = probe_indices(len(grid.points))
    neighbors, spacing = grid.neighbors(query_indices, MIN_NEIGHBORS)
    median = max(float(np.median(spacing)), 1e-9)
    return measure_noise(grid, query_indices, neighbors, median) / median


def median_spacing(cloud: np.ndarray) -> float:
    """Median spacing of a cloud's points (N, 3), N >= 1, in its units; a large cloud is subsampled first."""
    grid = native.NeighborGrid(subsample_hashed(cloud, MAX_SURFACE_POINTS))
    _, spacing = grid.neighbors(np.arange(len(grid.points), dtype=np.int32), MIN_NEIGHBORS)
    return float(np.median(spacing))


def probe_indices(count: int) -> np.ndarray:
    """Evenly spread rows (M,) int32 of a cloud of `count` points, at which noise is measured."""
    return np.arange(0, count, max(count // NOISE_PROBES, 1), dtype=np.int32)


def neighbor_count(noise: float) -> int:
    """Number of neighbors that patches are fitted to, for noise in spacings."""
    return int(min(MIN_NEIGHBORS + NEIGHBORS_PER_NOISE * noise, MAX_NEIGHBORS))


def measure_noise(
    grid: native.NeighborGrid | native.ScreenGrid, query_indices: np.ndarray, neighbors: np.ndarray, spacing: float
) -> float:  # fmt: skip
    """Standard deviation of the points off their surface, in the cloud's units.

    Args:
        grid: the cloud.
        query_indices: (M,) int32, rows of the points at which noise is measured.
        neighbors: (M, K) int32, their neighbors.
        spacing: median spacing of the cloud.
    """
    noise, limit = residual_noise(grid.points, neighbors), math.inf
    if len(grid.points) >= MIN_NEIGHBORS:
        slab_noise, steep_share = least_median_noise(grid.points, query_indices, neighbors)
        if steep_share > MULTI_SHEET_SHARE:
            if slab_noise < SLAB_NOISE_LIMIT * spacing:
                return slab_noise
            noise, limit = max(noise, slab_noise), SLAB_NOISE_CAP * slab_noise
    while neighbor_count(noise / spacing) >= 2 * neighbors.shape[1] <= len(grid.points):
        # the patch is too small to show all of so large a noise
        neighbors, _ = grid.neighbors(query_indices, 2 * neighbors.shape[1])
        noise = max(noise, residual_noise(grid.points, neighbors))
    return min(noise, limit)


def least_median_noise(points: np.ndarray, query_indices: np.ndarray, neighbors: np.ndarray) -> tuple[float, float]:
    """Noise by the nearer half of the neighbors (M, 16), and the share of neighbors above or below their point.

    The other side of a plate, or another bar close by, is not in the nearer half, so it does not count as noise. The
    share distinguishes such sheets from the depth steps of a depth camera.
    """
    variances = []
    for neighbor_number, held, width_to_noise in LEAST_MEDIAN_SLABS:
        widths, steep = native.fit_thin_slabs(points, query_indices, neighbors[:, :neighbor_number], held)
        variances.append((float(np.median(widths)) / width_to_noise) ** 2)
    return remove_curvature_bias(*variances), float(steep.mean())


def residual_noise(points: np.ndarray, neighbors: np.ndarray) -> float:
    """The points' standard deviation off planes through their neighbors (M, K), without the surface's curvature."""
    variances = []
    for count in (neighbors.shape[1] // 2, neighbors.shape[1]):
        spread = native.fit_planes(points, np.ascontiguousarray(neighbors[:, :count]))[1]
        variances.append(float(np.median(spread)) ** 2 * count / (count - 3))  # a plane has three parameters
    return remove_curvature_bias(*variances)


def remove_curvature_bias(variance: float, variance_of_twice: float) -> float:
    """Standard deviation of noise alone, from the variance off planes through K neighbors and through 2 K.

    Curvature adds a variance that grows with the square of the patch's area, so fourfold from K to 2 K neighbors; the
    variance of noise stays the same.
    """
    return math.sqrt(max(4 * variance - variance_of_twice, 0.0) / 3)
