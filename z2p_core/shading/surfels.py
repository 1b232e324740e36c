"""The discs that a cloud's points are drawn as: how large each is, and further ones in small holes.

A disc closes the surface up to its neighbours' (after Zwicker et al., Surface Splatting, 2001), and leaves borders as
they are. A small hole amid a surface is the scan's, not the thing's: a disc of its own closes it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from z2p_core import native
from z2p_core.linalg import row_dots
from z2p_core.surface.normals import Tangents

RADIUS_PER_VORONOI_EXTENT = 1.45
"""Radius of a disc in those of its Voronoi cell, which alone would close the surface."""
SMALLEST, LARGEST = 0.8, 1.5
"""Radius of a disc in spacings, at least and at most."""
NEARBY, FARTHER = 24, 48
"""Neighbours that a cell is looked for among, and those among which one that they leave open is looked for again."""
HOLE, TORN, BORDER = 1.9, 3.5, 0.7
"""Spacings that a cell reaches at a hole, at least, and at a border or a large hole: chance leaves no gaps of more than
two, and scans look better with small holes closed. And the radius of a border's disc, which closes nothing."""
NARROWEST, WIDEST = 0.5, 2.5
"""Of a disc in the cloud's spacing, and in that around it: a sparse part is closed, a stray point stays a dot."""
ABOUT = 0.6
"""Of a Voronoi cell's reach, how far the places about a disc's middle lie from it."""
SAMPLES_PER_DISC = 5
"""That tell where a disc lies: its middle, and four about it."""
AROUND, APART = 32, 0.75
"""Points near a hole's middle that tell whether it is one, and the spacings within which two middles count as one."""


def surfel_radii(found: Tangents, typical: float) -> tuple[Tangents, np.ndarray]:
    """The discs of a cloud of that spacing: the tangents, with those of discs in holes at the end, and radii (M,)."""
    share = np.clip(found.spacing, NARROWEST * typical, WIDEST * np.maximum(found.around, typical))
    nearby = np.ascontiguousarray(found.neighbours[:, :NEARBY])
    reaches, _ = native.voronoi_extent(found.points, found.normals, np.arange(len(share), dtype=np.int32), nearby)
    radii = np.clip(RADIUS_PER_VORONOI_EXTENT * reaches, SMALLEST * share, LARGEST * share)
    near = np.maximum(np.minimum(found.spacing, found.around), NARROWEST * typical)
    rim = np.flatnonzero(reaches > HOLE * near).astype(np.int32)
    if not len(rim):
        return found, radii
    farther, _ = found.grid.neighbours(rim, FARTHER)
    solid, ends = native.voronoi_extent(found.points, found.normals, rim, farther, in_space=True)
    torn = rim[np.minimum(solid, reaches[rim]) > TORN * near[rim]]
    radii[torn] = BORDER * near[torn]
    small = (solid > HOLE * near[rim]) & (solid < TORN * near[rim])
    return _add_hole_surfels(found, radii, rim[small], solid[small], ends[small], typical)


def disc_sample_points(found: Tangents, radii: np.ndarray) -> np.ndarray:
    """Points (PLACES M, 3) float32 that tell where discs of radii (M,) lie better than their middles alone.

    Each disc's middle, and four places about it in its plane.
    """
    normals = found.normals
    aside = np.eye(3, dtype=np.float32)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, aside)
    first *= (ABOUT / RADIUS_PER_VORONOI_EXTENT * radii / np.sqrt(row_dots(first, first)))[:, None].astype(np.float32)
    second, middles = np.cross(normals, first), found.points
    places = np.stack([middles, middles + first, middles - first, middles + second, middles - second], axis=1)
    return places.reshape(-1, 3)  # a disc's stay together, as their shadows do in memory


def _add_hole_surfels(
    found: Tangents, radii: np.ndarray, rim: np.ndarray, reaches: np.ndarray, middles: np.ndarray, typical: float
) -> tuple[Tangents, np.ndarray]:
    """The tangents and radii of a cloud of that spacing, with those of discs in holes at the end.

    Points at the rim (M,) reach so far (M,) into them, up to their middles (M, 3).
    """
    cells = np.floor(middles / (APART * typical)).astype(np.int64)
    _, once = np.unique(cells, axis=0, return_index=True)
    rim, reaches, middles = rim[once], reaches[once], middles[once]
    around = found.grid.around(middles, AROUND)
    own, middles, normals = native.find_hole_discs(found.points, found.normals, middles, found.normals[rim], reaches, around)
    kept = own > 0
    if not kept.any():
        return found, radii
    rim, count = rim[kept], found.neighbours.shape[1]
    further = replace(
        found,
        points=np.concatenate([found.points, middles[kept]]),
        spacing=np.concatenate([found.spacing, found.spacing[rim]]),
        normals=np.concatenate([found.normals, normals[kept]]),
        around=np.concatenate([found.around, found.around[rim]]),
        neighbours=np.concatenate([found.neighbours, found.grid.around(middles[kept], count)]),
    )
    return further, np.concatenate([radii, own[kept]])
