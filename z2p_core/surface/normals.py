"""Where the surface of a bare cloud lies and which way it faces: patches through as many neighbours as noise asks for.

First a plane (Hoppe et al., Surface Reconstruction from Unorganized Points, 1992) through all neighbours alike; then,
twice, a curved patch (Cazals and Pouget, osculating jets, 2005) through those that agree with the answer before, which
keeps creases and close sheets apart; then neighbours agree upon their patches, by a small network that has learnt how
(after Satorras et al., E(n) Equivariant Graph Neural Networks, 2021). Of a noisy cloud more neighbours are asked, and
its points are moved onto their patches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.parallel import run_async

MIN_NEIGHBORS, MAX_NEIGHBORS, NEIGHBORS_PER_NOISE = 16, 64, 75.0
"""Neighbours of a clean cloud, of the noisiest one, and how many more for noise as large as the spacing."""
REMEASURE_NOISE_TO_SPACING, SUBSAMPLE_NOISE_TO_SPACING, MIN_KEPT_POINTS = 0.45, 0.83, 2_000
"""Noise in spacings from which on it is measured among `MAX_NEIGHBORS` neighbours as well; what it is there when the surface
drowns in it, for they do not reach beyond it; and about how many points are kept of such a cloud at least."""
RESUBSAMPLE_SALT = 0x297A2D39
"""Salt by which points are chosen among those that were chosen before; times 2, 3, ... among those in turn."""
NOISE_PROBES = 400
"""Points at which noise is measured."""
MAX_SURFACE_POINTS = 40_000
"""Of larger clouds so many points, chosen by their coordinates, stand for all."""
JET_ITERATIONS = 2
"""How often a patch is fitted, each time from the normals before."""
PLANE_TOLERANCE_SPACINGS, PLANE_TOLERANCE_SIGMAS = 0.4, 2.0
"""How far from the plane before a neighbour still counts: in spacings, and in standard deviations of the noise."""
LEAST_MEDIAN_SLABS = ((8, 5, 0.211), (16, 9, 0.567))
"""Of so many neighbours a slab holds so many, and is half as wide as so much of noise of a seventh of the spacing."""
SLAB_NOISE_LIMIT = 0.2
"""Noise in spacings up to which slabs tell it: they hardly grow any more with what is larger."""
SLAB_NOISE_CAP = 1.6
"""How many times what slabs tell noise is at most, where it is larger and other sheets are close by."""
MIN_SCALE_TO_SPACING = 0.2
"""Spacing in the cloud's, at least, where neighbours agree: of points that come twice it is 0."""
MULTI_SHEET_SHARE = 0.06
"""Share of neighbours above or below a point from which on there are sheets close to each other."""
CLEAN_ROUGHNESS_TO_SPACING = 0.1
"""Of a clean surface at one spacing: where noise is as large, a point goes half the way to its patch."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points (N, 3), spacing (N,) and unit normals (N, 3) of either sign, all float32, and the noise, in world units.

    Spacing is the side of the square patch of surface that is a point's share; `neighbor_spacing` (N,) is that of a neighbour,
    which is as wide where the cloud is sparse, and narrow beside a stray point. Neighbours (N, K) int32 are the rows of
    the points nearest to each, itself among them, and `grid` finds more of them.
    """

    points: np.ndarray
    spacing: np.ndarray
    normals: np.ndarray
    noise: float
    neighbor_spacing: np.ndarray
    neighbors: np.ndarray
    grid: native.NeighborGrid


@dataclass(frozen=True)
class LocalFit:
    """Patches as each point fits its own: `grid` of the points (N, 3), and as in `SurfacePoints` for the rest.

    `median_spacing` is the median spacing, and `scale` (N,), above 0, the spacing that as many neighbours would have were they
    the fewest.
    """

    grid: native.NeighborGrid
    neighbors: np.ndarray
    spacing: np.ndarray
    normals: np.ndarray
    scale: np.ndarray
    median_spacing: float
    noise: float


def estimate_surface(cloud: np.ndarray, agreed: bool = True) -> SurfacePoints:
    """The tangent planes of a cloud (N, 3), N >= 1, in an order that does not depend on the cloud's.

    Unless `agreed`, each point keeps to its own patch, and stays where it is.
    """
    own, times = fit_local_patches(cloud), 0
    while len(cloud) >= 3 * MIN_KEPT_POINTS and noise_exceeds_patch(own):
        times += 1
        cloud = subsample_hashed(cloud, len(cloud) // 3, times * RESUBSAMPLE_SALT & 0xFFFFFFFF)
        own = fit_local_patches(cloud)
    points, normals = own.grid.points, own.normals
    if agreed and len(cloud) >= MIN_NEIGHBORS:
        patches, normals = native.refine_normals(points, normals, own.neighbors, own.scale, own.noise / own.median_spacing)
        points = project_to_patches(points, patches, own.spacing, own.noise)
    around = own.spacing[own.neighbors[:, MIN_NEIGHBORS // 2]]
    return SurfacePoints(points, own.spacing, normals, own.noise, around, own.neighbors, own.grid)


def noise_exceeds_patch(own: LocalFit) -> bool:
    """Whether noise is so large that patches do not reach beyond it. Those of a third of the points reach farther."""
    if own.noise < REMEASURE_NOISE_TO_SPACING * own.median_spacing:
        return False
    found, _ = own.grid.neighbors(probe_indices(len(own.grid.points)), MAX_NEIGHBORS)
    return residual_noise(own.grid.points, found) > SUBSAMPLE_NOISE_TO_SPACING * own.median_spacing


def fit_local_patches(cloud: np.ndarray) -> LocalFit:
    """The patches of a cloud (N, 3), N >= 1, before neighbours agree upon them."""
    grid = native.NeighborGrid(cloud)
    everyone = np.arange(len(cloud), dtype=np.int32)
    found, spacing = grid.neighbors(everyone, MIN_NEIGHBORS)
    typical = max(float(np.median(spacing)), 1e-9)
    asked = probe_indices(len(cloud))
    measured = run_async(measure_noise, grid, asked, found[asked], typical)
    normals, _ = native.fit_planes(grid.points, found)  # as most clouds are so clean that these neighbours will do
    noise = measured.result()
    count = neighbor_count(noise / typical)
    if count > MIN_NEIGHBORS:
        found, _ = grid.neighbors(everyone, count)
        normals, _ = native.fit_planes(grid.points, found)
    wider = np.float32(math.sqrt(count / MIN_NEIGHBORS))
    tolerance = PLANE_TOLERANCE_SPACINGS * wider * spacing + np.float32(PLANE_TOLERANCE_SIGMAS * noise)
    for _ in range(JET_ITERATIONS):
        normals, _ = native.fit_jets(grid.points, normals, everyone, found, tolerance, wider * spacing)
    scale = wider * np.maximum(spacing, np.float32(MIN_SCALE_TO_SPACING * typical))
    return LocalFit(grid, found, spacing, normals, scale, typical, noise)


def noise_to_spacing(cloud: np.ndarray) -> float:
    """Standard deviation of a cloud's points (N, 3) off their surface, in spacings; 0 for fewer than 16 points."""
    if len(cloud) < MIN_NEIGHBORS:
        return 0.0
    grid = native.NeighborGrid(subsample_hashed(cloud, MAX_SURFACE_POINTS))
    asked = probe_indices(len(grid.points))
    found, spacing = grid.neighbors(asked, MIN_NEIGHBORS)
    typical = max(float(np.median(spacing)), 1e-9)
    return measure_noise(grid, asked, found, typical) / typical


def median_spacing(cloud: np.ndarray) -> float:
    """Median spacing of a cloud's points (N, 3), N >= 1, or of those that stand for so many; in its units."""
    grid = native.NeighborGrid(subsample_hashed(cloud, MAX_SURFACE_POINTS))
    _, spacing = grid.neighbors(np.arange(len(grid.points), dtype=np.int32), MIN_NEIGHBORS)
    return float(np.median(spacing))


def probe_indices(count: int) -> np.ndarray:
    """Rows (M,) int32 at which noise is measured, of so many."""
    return np.arange(0, count, max(count // NOISE_PROBES, 1), dtype=np.int32)


def measure_noise(grid: native.NeighborGrid, asked: np.ndarray, found: np.ndarray, spacing: float) -> float:
    """Standard deviation of the points off their surface, from neighbours found (M, K) of those asked for (M,)."""
    noise, most = residual_noise(grid.points, found), math.inf
    if len(grid.points) >= MIN_NEIGHBORS:
        least, steep = least_median_noise(grid.points, asked, found)
        if steep > MULTI_SHEET_SHARE:  # sheets close to each other, where planes tell neither their noise nor that there is none
            if least < SLAB_NOISE_LIMIT * spacing:
                return least
            noise, most = max(noise, least), SLAB_NOISE_CAP * least
    while neighbor_count(noise / spacing) >= 2 * found.shape[1] <= len(grid.points):
        # noise so large that it is not all seen in so small a patch
        found, _ = grid.neighbors(asked, 2 * found.shape[1])
        noise = max(noise, residual_noise(grid.points, found))
    return min(noise, most)


def least_median_noise(points: np.ndarray, asked: np.ndarray, found: np.ndarray) -> tuple[float, float]:
    """The points' standard deviation as the better half of their neighbours found (M, 16) tells it.

    The other side of a plate, or another bar close by, is not in that half, and so is not taken for noise. Also the
    share of neighbours above and below the points, which tells such from the steps of a depth camera.
    """
    variances = []
    for many, held, share in LEAST_MEDIAN_SLABS:
        widths, steep = native.fit_thin_slabs(points, asked, found[:, :many], held)
        variances.append((float(np.median(widths)) / share) ** 2)
    return remove_curvature_bias(*variances), float(steep.mean())


def residual_noise(points: np.ndarray, found: np.ndarray) -> float:
    """The points' standard deviation off planes through neighbours found (M, K)."""
    variances = []
    for many in (found.shape[1] // 2, found.shape[1]):
        spread = native.fit_planes(points, np.ascontiguousarray(found[:, :many]))[1]
        variances.append(float(np.median(spread)) ** 2 * many / (many - 3))  # three of them fit the plane
    return remove_curvature_bias(*variances)


def remove_curvature_bias(fewer: float, twice: float) -> float:
    """Standard deviation, of variances among some neighbours and twice as many, that a curved surface leaves open.

    What it leaves grows with the patch, to four times the variance over twice the points; noise does not.
    """
    return math.sqrt(max(4 * fewer - twice, 0.0) / 3)


def neighbor_count(noise: float) -> int:
    """How many neighbours a plane is fitted to, where noise is given in spacings."""
    return int(min(MIN_NEIGHBORS + NEIGHBORS_PER_NOISE * noise, MAX_NEIGHBORS))


def project_to_patches(points: np.ndarray, patches: np.ndarray, spacing: np.ndarray, noise: float) -> np.ndarray:
    """Points (N, 3), each moved towards its place on its patch (N, 3), the further the more of the way is noise."""
    if noise == 0:
        return points
    share = noise**2 / (noise**2 + (CLEAN_ROUGHNESS_TO_SPACING * spacing) ** 2)
    result: np.ndarray = points + share[:, None] * (patches - points)
    return result


def subsample_hashed(cloud: np.ndarray, most: int, salt: int = 0) -> np.ndarray:
    """At most about `most` points of a cloud (N, 3) float32, chosen by their coordinates whatever their order.

    What is left of a cloud can be thinned again by another `salt` only: by the same one too many of them would stay.
    """
    if len(cloud) <= most:
        return cloud
    bits = np.ascontiguousarray(cloud, dtype=np.float32).view(np.uint32)
    mixed = bits[:, 0] * np.uint32(0x9E3779B1) ^ bits[:, 1] * np.uint32(0x85EBCA77) ^ bits[:, 2] * np.uint32(0xC2B2AE3D)
    mixed = (mixed ^ mixed >> np.uint32(15) ^ np.uint32(salt)) * np.uint32(0x2C1B3C6D)
    kept: np.ndarray = cloud[mixed < np.uint32(min(most / len(cloud), 1.0) * 0xFFFFFFFF)]
    if 0 < len(kept) <= 1.5 * most:
        return kept
    once = np.unique(cloud, axis=0)  # many that are one point in these numbers stay or go together
    return once[:: -(-len(once) // most)]
