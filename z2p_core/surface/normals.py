"""Surface of a bare cloud: normals, spacing, and points moved from their noisy places onto fitted patches.

1. Tangent planes through the 16 to 64 nearest neighbors, more for noisier clouds (Hoppe et al., Surface Reconstruction
   from Unorganized Points, 1992).
2. Twice, a curved patch (Cazals and Pouget, Estimating Differential Quantities using Polynomial Fitting of Osculating
   Jets, 2005). Neighbors weigh less the farther they lie from the previous plane and the more their normals differ,
   which keeps creases and close sheets apart.
3. A small trained graph network that refines positions and normals by messages between neighbors (after Satorras et
   al., E(n) Equivariant Graph Neural Networks, 2021; trained by `scripts/train_normal_gnn.py`).
4. Points move onto their patches, the farther the larger the noise is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.surface.noise_level import (
    MAX_NEIGHBORS,
    MIN_NEIGHBORS,
    measure_noise,
    neighbor_count,
    probe_indices,
    residual_noise,
)
from z2p_core.surface.subsampling import RESUBSAMPLE_SALT, subsample_hashed

REMEASURE_NOISE_TO_SPACING = 0.45
"""Noise, in spacings, from which it is measured again with `MAX_NEIGHBORS` neighbors."""
SUBSAMPLE_NOISE_TO_SPACING = 0.83
"""Noise by that measurement, in spacings, above which even those patches are too small and the cloud is subsampled."""
MIN_KEPT_POINTS = 2_000
"""Points that subsampling leaves at least, about."""
JET_ITERATIONS = 2
"""Times that a jet is fitted, each time weighted by the normals before."""
PLANE_TOLERANCE_SPACINGS = 0.4
"""Distance from the previous plane at which a neighbor's weight has fallen to a quarter: this many spacings ..."""
PLANE_TOLERANCE_SIGMAS = 2.0
"""... plus this many standard deviations of the noise."""
MIN_SCALE_TO_SPACING = 0.2
"""Smallest length by which the network measures steps, in median spacings: the spacing of coinciding points is 0."""
CLEAN_ROUGHNESS_TO_SPACING = 0.1
"""Roughness of a clean surface, in spacings: where noise is as large, a point moves half way to its patch."""


Neighborhoods = native.NeighborGrid | native.ScreenGrid
"""Finds the nearest among its `points` (N, 3)."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points of a surface, in an order that does not depend on the order of the cloud's points."""

    points: np.ndarray
    """(N, 3) float32, world units."""
    spacing: np.ndarray
    """(N,) float32, side of the square patch of surface that is a point's share, world units."""
    normals: np.ndarray
    """(N, 3) float32, unit vectors of either sign."""
    noise: float
    """Standard deviation of the points off their surface before they were moved, world units."""
    neighbor_spacing: np.ndarray
    """(N,) float32, spacing at the 9th nearest point: it stays small beside an isolated point, whose own is large."""
    neighbors: np.ndarray
    """(N, K) int32, rows of the points nearest to each, itself included."""
    grid: Neighborhoods
    """Finds more neighbors among the points as they were before they were moved."""


@dataclass(frozen=True)
class LocalFit:
    """Jets fitted to each point's neighborhood, before the graph network."""

    grid: Neighborhoods
    """Its `points` (N, 3) are those that the other fields belong to."""
    neighbors: np.ndarray
    """(N, K) int32."""
    spacing: np.ndarray
    """(N,) float32, as in `SurfacePoints`."""
    normals: np.ndarray
    """(N, 3) float32, unit vectors of either sign."""
    scale: np.ndarray
    """(N,) float32, above 0: the spacing at which `MIN_NEIGHBORS` neighbors would reach as far as these K do."""
    median_spacing: float
    noise: float
    """As in `SurfacePoints`."""


def estimate_surface(
    cloud: np.ndarray, use_normal_gnn: bool = True, count_neighbors: Callable[[float], int] = neighbor_count,
    grid: Neighborhoods | None = None,
) -> SurfacePoints:  # fmt: skip
    """Points, spacing and normals of the surface that a cloud (N, 3) samples, N >= 1.

    Args:
        cloud: points, float32 or convertible, in world units.
        use_normal_gnn: refine normals by the graph network and move points onto their patches; else points stay.
        count_neighbors: how many neighbors patches are fitted to, for noise in spacings.
        grid: that of the cloud, if there is one; its points are those of the surface.
    """
    fit, subsamplings = fit_local_patches(cloud, count_neighbors, grid), 0
    while len(cloud) >= 3 * MIN_KEPT_POINTS and noise_exceeds_patch(fit):
        subsamplings += 1
        cloud = subsample_hashed(cloud, len(cloud) // 3, subsamplings * RESUBSAMPLE_SALT & 0xFFFFFFFF)
        fit = fit_local_patches(cloud, count_neighbors)
    points, normals = fit.grid.points, fit.normals
    if use_normal_gnn and len(cloud) >= MIN_NEIGHBORS:
        patches, normals = native.refine_normals(
            points, normals, fit.neighbors, fit.scale, fit.noise / fit.median_spacing
        )
        points = project_to_patches(points, patches, fit.spacing, fit.noise)
    neighbor_spacing = fit.spacing[fit.neighbors[:, MIN_NEIGHBORS // 2]]
    return SurfacePoints(points, fit.spacing, normals, fit.noise, neighbor_spacing, fit.neighbors, fit.grid)


def noise_exceeds_patch(fit: LocalFit) -> bool:
    """True if the noise exceeds the patch size; subsampling to a third makes patches sqrt(3) wider."""
    if fit.noise < REMEASURE_NOISE_TO_SPACING * fit.median_spacing:
        return False
    neighbors, _ = fit.grid.neighbors(probe_indices(len(fit.grid.points)), MAX_NEIGHBORS)
    return residual_noise(fit.grid.points, neighbors) > SUBSAMPLE_NOISE_TO_SPACING * fit.median_spacing


def fit_local_patches(
    cloud: np.ndarray, count_neighbors: Callable[[float], int] = neighbor_count, grid: Neighborhoods | None = None
) -> LocalFit:  # fmt: skip
    """Tangent planes, then jets, of a cloud (N, 3), N >= 1; see `estimate_surface`."""
    grid = grid or native.NeighborGrid(cloud)
    probes = probe_indices(len(grid.points))
    neighbors, spacing = grid.neighbors(probes, MIN_NEIGHBORS)
    median = max(float(np.median(spacing)), 1e-9)
    noise = measure_noise(grid, probes, neighbors, median)
    count = count_neighbors(noise / median)
    all_indices = np.arange(len(grid.points), dtype=np.int32)
    neighbors, spacing = grid.neighbors(all_indices, count)
    median = max(float(np.median(spacing)), 1e-9)
    normals, _ = native.fit_planes(grid.points, neighbors)
    widening = np.float32(math.sqrt(count / MIN_NEIGHBORS))
    tolerance = PLANE_TOLERANCE_SPACINGS * widening * spacing + np.float32(PLANE_TOLERANCE_SIGMAS * noise)
    for _ in range(JET_ITERATIONS):
        normals, _ = native.fit_jets(grid.points, normals, all_indices, neighbors, tolerance, widening * spacing)
    scale = widening * np.maximum(spacing, np.float32(MIN_SCALE_TO_SPACING * median))
    return LocalFit(grid, neighbors, spacing, normals, scale, median, noise)


def project_to_patches(points: np.ndarray, patches: np.ndarray, spacing: np.ndarray, noise: float) -> np.ndarray:
    """Points (N, 3) moved towards their places on patches (N, 3), by the share of their offset that noise explains.

    Args:
        points: noisy points.
        patches: where their patches lie.
        spacing: (N,), the points'.
        noise: its standard deviation; 0 leaves all points where they are.
    """
    if noise == 0:
        return points
    share = noise**2 / (noise**2 + (CLEAN_ROUGHNESS_TO_SPACING * spacing) ** 2)
    projected: np.ndarray = points + share[:, None] * (patches - points)
    return projected
