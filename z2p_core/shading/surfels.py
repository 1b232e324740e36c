"""The surfels that a cloud is drawn as: a disc at each point, and further discs that close small holes.

A surfel's radius comes from its Voronoi cell among its neighbors in the tangent plane: discs that wide close the
surface (after Zwicker et al., Surface Splatting, 2001). Where a cell reaches so far that chance does not explain it,
the point lies at the rim of a hole. A small hole within a surface comes from the scan rather than from the object, and
is closed by a disc of its own; borders and large holes stay open.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from z2p_core import native
from z2p_core.linalg import row_dots
from z2p_core.surface.normals import SurfacePoints

RADIUS_PER_VORONOI_EXTENT = 1.45
"""Radius of a surfel over the extent of its Voronoi cell; 1 would just close the surface."""
MIN_RADIUS_SPACINGS = 0.8
MAX_RADIUS_SPACINGS = 1.5
"""Limits of a surfel's radius, in its own spacing (which is limited by the two constants below)."""
MIN_SPACING_SHARE = 0.5
"""Smallest spacing of a point that counts, over the cloud's median spacing."""
MAX_SPACING_SHARE = 2.5
"""Largest one, over the spacing of its neighbors: a sparse region is closed, an isolated point stays a dot."""
CELL_NEIGHBORS = 24
"""Neighbors among which a Voronoi cell is computed."""
RIM_CELL_NEIGHBORS = 48
"""Neighbors among which it is computed again for points that seem to lie at a hole."""
HOLE_MIN_SPACINGS = 1.9
"""Extent of a Voronoi cell from which on a point lies at the rim of a hole, in spacings: random points leave no gaps
of more than 2."""
HOLE_MAX_SPACINGS = 3.5
"""Extent from which on it lies at a border or at a hole too large to be closed, in spacings."""
BORDER_RADIUS_SPACINGS = 0.7
"""Radius of surfels at borders, in spacings: they close nothing."""
SAMPLES_PER_DISC = 5
"""Points that stand for a surfel's disc in shadow maps: its center, and four around it."""
SAMPLE_OFFSET_EXTENTS = 0.6
"""Distance of those four from the center, over the extent of the Voronoi cell."""
HOLE_NEIGHBORS = 32
"""Points around a hole's center that decide whether it is one."""
MERGE_DISTANCE_SPACINGS = 0.75
"""Grid cell in which two centers of holes count as one, in spacings."""


def make_surfels(surface: SurfacePoints, spacing: float | np.ndarray) -> tuple[SurfacePoints, np.ndarray]:
    """The surfels of a surface, and their radii (M,) float32 in world units.

    The first N surfels are those of the surface's points; those that close holes follow. `spacing`, above 0, is the
    median one of the points, or that near each of them, (N,).
    """
    spacing = np.broadcast_to(np.float32(spacing), len(surface.points))
    points, normals = surface.points, surface.normals
    widest = MAX_SPACING_SHARE * np.maximum(surface.neighbor_spacing, spacing)
    own_spacing = np.clip(surface.spacing, MIN_SPACING_SHARE * spacing, widest)
    nearest = np.ascontiguousarray(surface.neighbors[:, :CELL_NEIGHBORS])
    extents, _ = native.voronoi_extent(points, normals, np.arange(len(points), dtype=np.int32), nearest)
    radii = np.clip(
        RADIUS_PER_VORONOI_EXTENT * extents, MIN_RADIUS_SPACINGS * own_spacing, MAX_RADIUS_SPACINGS * own_spacing
    )
    local_spacing = np.maximum(np.minimum(surface.spacing, surface.neighbor_spacing), MIN_SPACING_SHARE * spacing)
    rim = np.flatnonzero(extents > HOLE_MIN_SPACINGS * local_spacing).astype(np.int32)
    if not len(rim):
        return surface, radii
    more_neighbors, _ = surface.grid.neighbors(rim, RIM_CELL_NEIGHBORS)
    hole_radii, hole_centers = native.voronoi_extent(points, normals, rim, more_neighbors, in_space=True)
    at_border = rim[np.minimum(hole_radii, extents[rim]) > HOLE_MAX_SPACINGS * local_spacing[rim]]
    radii[at_border] = BORDER_RADIUS_SPACINGS * local_spacing[at_border]
    small = hole_radii > HOLE_MIN_SPACINGS * local_spacing[rim]
    small &= hole_radii < HOLE_MAX_SPACINGS * local_spacing[rim]
    return _add_hole_surfels(surface, radii, rim[small], hole_radii[small], hole_centers[small], spacing)


def disc_sample_points(surfels: SurfacePoints, radii: np.ndarray) -> np.ndarray:
    """Points (SAMPLES_PER_DISC M, 3) float32 that stand for the surfels' discs: each center, and four around it.

    Five points cover a disc's area evenly enough for shadow maps, which its center alone does not.
    """
    normals, centers = surfels.normals, surfels.points
    least_axis = np.eye(3, dtype=np.float32)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, least_axis)
    offset = SAMPLE_OFFSET_EXTENTS / RADIUS_PER_VORONOI_EXTENT * radii
    first *= (offset / np.sqrt(row_dots(first, first)))[:, None].astype(np.float32)
    second = np.cross(normals, first)
    samples = np.stack([centers, centers + first, centers - first, centers + second, centers - second], axis=1)
    return samples.reshape(-1, 3)  # a disc's samples lie next to each other, as their shadows then do in memory


def _add_hole_surfels(
    surface: SurfacePoints, radii: np.ndarray, rim: np.ndarray, hole_radii: np.ndarray, hole_centers: np.ndarray,
    spacing: np.ndarray,
) -> tuple[SurfacePoints, np.ndarray]:  # fmt: skip
    """The surfels and radii of a surface whose points have the spacings (N,), with those that close holes at the end.

    `rim` (R,) int32 are the points at rims; the hole at each has the radius (R,) and the center (R, 3).
    """
    first = _distinct_cells(hole_centers, MERGE_DISTANCE_SPACINGS * spacing[rim])
    rim, hole_radii, hole_centers = rim[first], hole_radii[first], hole_centers[first]
    nearest = surface.grid.neighbors_of_positions(hole_centers, HOLE_NEIGHBORS)
    disc_radii, centers, normals = native.find_hole_discs(
        surface.points, surface.normals, hole_centers, surface.normals[rim], hole_radii, nearest
    )
    is_hole = disc_radii > 0
    if not is_hole.any():
        return surface, radii
    rim, centers, neighbor_count = rim[is_hole], centers[is_hole], surface.neighbors.shape[1]
    surfels = replace(
        surface,
        points=np.concatenate([surface.points, centers]),
        spacing=np.concatenate([surface.spacing, surface.spacing[rim]]),
        normals=np.concatenate([surface.normals, normals[is_hole]]),
        neighbor_spacing=np.concatenate([surface.neighbor_spacing, surface.neighbor_spacing[rim]]),
        neighbors=np.concatenate([surface.neighbors, surface.grid.neighbors_of_positions(centers, neighbor_count)]),
    )
    return surfels, np.concatenate([radii, disc_radii[is_hole]])


def _distinct_cells(centers: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Indices of one center of each grid cell that holds some of them (R, 3), for cells of these widths (R,)."""
    if len(widths) and widths.min() < widths.max():  # cells whose widths are powers of 2 lie within each other
        widths = np.exp2(np.floor(np.log2(widths)))
    cells = np.column_stack([np.floor(centers / widths[:, None]), widths])
    return np.unique(cells, axis=0, return_index=True)[1]
