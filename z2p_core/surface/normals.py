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

FEWEST, MOST, MORE = 16, 64, 75.0
"""Neighbours of a clean cloud, of the noisiest one, and how many more for noise as large as the spacing."""
PATENT, DROWNED, FEWEST_KEPT = 0.45, 0.83, 2_000
"""Noise in spacings from which on it is measured among `MOST` neighbours as well; what it is there when the surface
drowns in it, for they do not reach beyond it; and about how many points are kept of such a cloud at least."""
AGAIN = 0x297A2D39
"""Salt by which points are chosen among those that were chosen before; times 2, 3, ... among those in turn."""
PROBES = 400
"""Points at which noise is measured."""
MOST_POINTS = 40_000
"""Of larger clouds so many points, chosen by their coordinates, stand for all."""
PATCHES = 2
"""How often a patch is fitted, each time from the normals before."""
LOOSE, LOOSER = 0.4, 2.0
"""How far from the plane before a neighbour still counts: in spacings, and in standard deviations of the noise."""
SLABS = ((8, 5, 0.211), (16, 9, 0.567))
"""Of so many neighbours a slab holds so many, and is half as wide as so much of noise of a seventh of the spacing."""
TOLD = 0.2
"""Noise in spacings up to which slabs tell it: they hardly grow any more with what is larger."""
UNTOLD = 1.6
"""How many times what slabs tell noise is at most, where it is larger and other sheets are close by."""
NARROWEST = 0.2
"""Spacing in the cloud's, at least, where neighbours agree: of points that come twice it is 0."""
STACKED = 0.06
"""Share of neighbours above or below a point from which on there are sheets close to each other."""
BUMPS = 0.1
"""Of a clean surface at one spacing: where noise is as large, a point goes half the way to its patch."""


@dataclass(frozen=True)
class Tangents:
    """Points (N, 3), spacing (N,) and unit normals (N, 3) of either sign, all float32, and the noise, in world units.

    Spacing is the side of the square patch of surface that is a point's share; `around` (N,) is that of a neighbour,
    which is as wide where the cloud is sparse, and narrow beside a stray point. Neighbours (N, K) int32 are the rows of
    the points nearest to each, itself among them, and `grid` finds more of them.
    """

    points: np.ndarray
    spacing: np.ndarray
    normals: np.ndarray
    noise: float
    around: np.ndarray
    neighbours: np.ndarray
    grid: native.Grid


@dataclass(frozen=True)
class Fitted:
    """Patches as each point fits its own: `grid` of the points (N, 3), and as in `Tangents` for the rest.

    `typical` is the median spacing, and `scale` (N,), above 0, the spacing that as many neighbours would have were they
    the fewest.
    """

    grid: native.Grid
    neighbours: np.ndarray
    spacing: np.ndarray
    normals: np.ndarray
    scale: np.ndarray
    typical: float
    noise: float


def tangents(cloud: np.ndarray, agreed: bool = True) -> Tangents:
    """The tangent planes of a cloud (N, 3), N >= 1, in an order that does not depend on the cloud's.

    Unless `agreed`, each point keeps to its own patch, and stays where it is.
    """
    own, times = fitted(cloud), 0
    while len(cloud) >= 3 * FEWEST_KEPT and drowned(own):
        times += 1
        cloud = thinned(cloud, len(cloud) // 3, times * AGAIN & 0xFFFFFFFF)
        own = fitted(cloud)
    points, normals = own.grid.points, own.normals
    if agreed and len(cloud) >= FEWEST:
        patches, normals = native.refine(points, normals, own.neighbours, own.scale, own.noise / own.typical)
        points = moved(points, patches, own.spacing, own.noise)
    around = own.spacing[own.neighbours[:, FEWEST // 2]]
    return Tangents(points, own.spacing, normals, own.noise, around, own.neighbours, own.grid)


def drowned(own: Fitted) -> bool:
    """Whether noise is so large that patches do not reach beyond it. Those of a third of the points reach farther."""
    if own.noise < PATENT * own.typical:
        return False
    found, _ = own.grid.neighbours(probes(len(own.grid.points)), MOST)
    return left_by_curvature(own.grid.points, found) > DROWNED * own.typical


def fitted(cloud: np.ndarray) -> Fitted:
    """The patches of a cloud (N, 3), N >= 1, before neighbours agree upon them."""
    grid = native.Grid(cloud)
    everyone = np.arange(len(cloud), dtype=np.int32)
    found, spacing = grid.neighbours(everyone, FEWEST)
    typical = max(float(np.median(spacing)), 1e-9)
    asked = probes(len(cloud))
    measured = run_async(noise_of, grid, asked, found[asked], typical)
    normals, _ = native.planes(grid.points, found)  # as most clouds are so clean that these neighbours will do
    noise = measured.result()
    count = neighbours_for(noise / typical)
    if count > FEWEST:
        found, _ = grid.neighbours(everyone, count)
        normals, _ = native.planes(grid.points, found)
    wider = np.float32(math.sqrt(count / FEWEST))
    tolerance = LOOSE * wider * spacing + np.float32(LOOSER * noise)
    for _ in range(PATCHES):
        normals, _ = native.jets(grid.points, normals, everyone, found, tolerance, wider * spacing)
    scale = wider * np.maximum(spacing, np.float32(NARROWEST * typical))
    return Fitted(grid, found, spacing, normals, scale, typical, noise)


def scatter(cloud: np.ndarray) -> float:
    """Standard deviation of a cloud's points (N, 3) off their surface, in spacings; 0 for fewer than 16 points."""
    if len(cloud) < FEWEST:
        return 0.0
    grid = native.Grid(thinned(cloud, MOST_POINTS))
    asked = probes(len(grid.points))
    found, spacing = grid.neighbours(asked, FEWEST)
    typical = max(float(np.median(spacing)), 1e-9)
    return noise_of(grid, asked, found, typical) / typical


def typical_spacing(cloud: np.ndarray) -> float:
    """Median spacing of a cloud's points (N, 3), N >= 1, or of those that stand for so many; in its units."""
    grid = native.Grid(thinned(cloud, MOST_POINTS))
    _, spacing = grid.neighbours(np.arange(len(grid.points), dtype=np.int32), FEWEST)
    return float(np.median(spacing))


def probes(count: int) -> np.ndarray:
    """Rows (M,) int32 at which noise is measured, of so many."""
    return np.arange(0, count, max(count // PROBES, 1), dtype=np.int32)


def noise_of(grid: native.Grid, asked: np.ndarray, found: np.ndarray, spacing: float) -> float:
    """Standard deviation of the points off their surface, from neighbours found (M, K) of those asked for (M,)."""
    noise, most = left_by_curvature(grid.points, found), math.inf
    if len(grid.points) >= FEWEST:
        least, steep = in_slabs(grid.points, asked, found)
        if steep > STACKED:  # sheets close to each other, where planes tell neither their noise nor that there is none
            if least < TOLD * spacing:
                return least
            noise, most = max(noise, least), UNTOLD * least
    while neighbours_for(noise / spacing) >= 2 * found.shape[1] <= len(grid.points):
        # noise so large that it is not all seen in so small a patch
        found, _ = grid.neighbours(asked, 2 * found.shape[1])
        noise = max(noise, left_by_curvature(grid.points, found))
    return min(noise, most)


def in_slabs(points: np.ndarray, asked: np.ndarray, found: np.ndarray) -> tuple[float, float]:
    """The points' standard deviation as the better half of their neighbours found (M, 16) tells it.

    The other side of a plate, or another bar close by, is not in that half, and so is not taken for noise. Also the
    share of neighbours above and below the points, which tells such from the steps of a depth camera.
    """
    variances = []
    for many, held, share in SLABS:
        widths, steep = native.slabs(points, asked, found[:, :many], held)
        variances.append((float(np.median(widths)) / share) ** 2)
    return without_curvature(*variances), float(steep.mean())


def left_by_curvature(points: np.ndarray, found: np.ndarray) -> float:
    """The points' standard deviation off planes through neighbours found (M, K)."""
    variances = []
    for many in (found.shape[1] // 2, found.shape[1]):
        spread = native.planes(points, np.ascontiguousarray(found[:, :many]))[1]
        variances.append(float(np.median(spread)) ** 2 * many / (many - 3))  # three of them fit the plane
    return without_curvature(*variances)


def without_curvature(fewer: float, twice: float) -> float:
    """Standard deviation, of variances among some neighbours and twice as many, that a curved surface leaves open.

    What it leaves grows with the patch, to four times the variance over twice the points; noise does not.
    """
    return math.sqrt(max(4 * fewer - twice, 0.0) / 3)


def neighbours_for(noise: float) -> int:
    """How many neighbours a plane is fitted to, where noise is given in spacings."""
    return int(min(FEWEST + MORE * noise, MOST))


def moved(points: np.ndarray, patches: np.ndarray, spacing: np.ndarray, noise: float) -> np.ndarray:
    """Points (N, 3), each moved towards its place on its patch (N, 3), the further the more of the way is noise."""
    if noise == 0:
        return points
    share = noise**2 / (noise**2 + (BUMPS * spacing) ** 2)
    result: np.ndarray = points + share[:, None] * (patches - points)
    return result


def thinned(cloud: np.ndarray, most: int, salt: int = 0) -> np.ndarray:
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
