"""Bindings of `c/surfels/`: discs in the tangent planes of a cloud's points, their extents, limits and rasterization.

N points, K neighbors of each, as indices. Arrays are float32 unless said otherwise; others are converted. Everything
is in world units.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np

from z2p_core.camera import Camera
from z2p_core.native.library import (
    FLOATS,
    FLOATS_OR_NONE,
    FLOATS_OUT,
    FLOATS_OUT_OR_NONE,
    INT,
    INTS,
    Struct,
    as_float32,
    call,
    check_output,
    declare,
)
from z2p_core.parallel import parallel_rows
from z2p_core.shading.channels import RASTERIZED

MAX_CLIP_PLANES = 4
"""Clip planes per disc, as in `c/surfels/disc_clipping.h`."""
TEXTURE_VALUES = 18
"""Numbers of a disc's texture, as in `c/surfels/disc_texture.h`."""


class RasterSettings(ctypes.Structure):
    """The C structure of that name (`c/surfels/surfel_raster.c`)."""

    _fields_ = [
        ("width", ctypes.c_int),
        ("height", ctypes.c_int),
        ("first_row", ctypes.c_int),
        ("last_row", ctypes.c_int),
        ("orthographic", ctypes.c_int),
        ("focal_x", ctypes.c_float),
        ("focal_y", ctypes.c_float),
        ("center_x", ctypes.c_float),
        ("center_y", ctypes.c_float),
        ("near_plane", ctypes.c_float),
        ("blend_depth_radii", ctypes.c_float),
        ("coverage_gain", ctypes.c_float),
        ("full_weight", ctypes.c_float),
        ("opaque_weight", ctypes.c_float),
        ("near_depth", ctypes.c_float),
        ("far_depth", ctypes.c_float),
    ]


declare(
    "z2p_voronoi_extent", points=FLOATS, normals=FLOATS, query_indices=INTS, neighbors=INTS, begin=INT, end=INT,
    neighbor_count=INT, in_space=INT, extents=FLOATS_OUT, farthest=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_find_hole_discs", points=FLOATS, normals=FLOATS, neighbors=INTS, count=INT, neighbor_count=INT, extents=FLOATS,
    positions=FLOATS_OUT, disc_normals=FLOATS_OUT, radii=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_offset_disc_centers", points=FLOATS, normals=FLOATS, radii=FLOATS, neighbors=INTS, begin=INT, end=INT,
    neighbor_count=INT, centers=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_disc_clip_planes", points=FLOATS, normals=FLOATS, radii=FLOATS, neighbors=INTS, begin=INT, end=INT,
    neighbor_count=INT, planes=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_rasterize_surfels", points=FLOATS, normals=FLOATS, radii=FLOATS, clip_planes=FLOATS, features=FLOATS,
    textures=FLOATS_OR_NONE, count=INT, settings=Struct(RasterSettings), image=FLOATS_OUT, colors=FLOATS_OUT_OR_NONE,
)  # fmt: skip
declare(
    "z2p_fit_disc_textures", centers=FLOATS, normals=FLOATS, radii=FLOATS, neighbors=INTS, albedo=FLOATS,
    offset=FLOATS, slope=FLOATS, begin=INT, end=INT, neighbor_count=INT, textures=FLOATS_OUT,
)  # fmt: skip


def voronoi_extent(
    points: np.ndarray, normals: np.ndarray, query_indices: np.ndarray, neighbors: np.ndarray, in_space: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """How far the Voronoi cells of some points reach in their tangent planes: in sixteen directions, the farthest.

    Discs a tenth wider than their cells leave no hole in a surface.

    Args:
        points: (N, 3) float32.
        normals: (N, 3) float32, unit length.
        query_indices: (M,) int32, the points whose cells are measured.
        neighbors: (M, K) int32, K <= 64, indices of their neighbors, which bound the cells.
        in_space: measure the cross section of the cells in space with the tangent planes, which neighbors beyond a
            crease bound as well; else the cells of the neighbors projected into the planes, without those that lie
            steeply over them.

    Returns:
        Extents (M,) float32, very large or infinite where neighbors leave a cell open, as at a border of the surface;
        and the farthest positions of the cells' borders (M, 3) float32.
    """
    extents, farthest = np.empty(len(query_indices), np.float32), np.empty((len(query_indices), 3), np.float32)
    cloud = (points, normals, query_indices, neighbors)

    def measure(begin: int, end: int) -> None:
        call("z2p_voronoi_extent", *cloud, begin, end, neighbors.shape[1], int(in_space), extents, farthest)

    parallel_rows(measure, len(query_indices))
    return extents, farthest


def find_hole_discs(
    points: np.ndarray, normals: np.ndarray, positions: np.ndarray, rim_normals: np.ndarray, extents: np.ndarray,
    neighbors: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Discs that close the small holes of a sampled surface.

    A candidate is a hole if no point is much nearer to it than its extent, and points of the surface surround it.

    Args:
        points: (N, 3) float32.
        normals: (N, 3) float32, unit length.
        positions: (M, 3), candidates for the middles of holes.
        rim_normals: (M, 3), the normal of a point at each candidate's rim.
        extents: (M,), distance from each candidate to its rim.
        neighbors: (M, K) int32, K <= 64, the points nearest to each candidate, nearest first.

    Returns:
        Radii (M,), 0 where there is no hole; positions (M, 3), moved towards the surface; and normals (M, 3).
    """
    discs, disc_normals = as_float32(positions).copy(), as_float32(rim_normals).copy()
    radii = np.empty(len(positions), np.float32)
    call(
        "z2p_find_hole_discs", points, normals, neighbors, len(positions), neighbors.shape[1], as_float32(extents),
        discs, disc_normals, radii,
    )  # fmt: skip
    return radii, discs, disc_normals


def offset_disc_centers(
    points: np.ndarray, normals: np.ndarray, radii: np.ndarray, neighbors: np.ndarray
) -> np.ndarray:
    """Centers (N, 3) of flat discs that lie on a curved surface on average, rather than touch it from outside.

    Args:
        points: (N, 3).
        normals: (N, 3), unit length, of either sign.
        radii: (N,), of the discs.
        neighbors: (N, K) int32, nearest first, each row beginning with the point itself.
    """
    centers = np.empty((len(points), 3), np.float32)
    discs = (as_float32(points), as_float32(normals), as_float32(radii), neighbors)

    def offset(begin: int, end: int) -> None:
        call("z2p_offset_disc_centers", *discs, begin, end, neighbors.shape[1], centers)

    parallel_rows(offset, len(points))
    return centers


def disc_clip_planes(points: np.ndarray, normals: np.ndarray, radii: np.ndarray, neighbors: np.ndarray) -> np.ndarray:
    """Planes (N, 4, 4) that clip discs at creases and outlines, where the surface bends away (Zwicker et al., 2004).

    A plane is a unit normal n and an offset d: nothing of the disc lies where n . x > d. It is the tangent plane of one
    of the neighbors. The plane nearest to the disc's center comes first; unused ones have normal 0 and offset infinity.

    Args:
        points: (N, 3), the discs' centers.
        normals: (N, 3), unit length; those of a visible disc and its neighbors face the viewer.
        radii: (N,), of the discs.
        neighbors: (N, K) int32.
    """
    planes = np.empty((len(points), MAX_CLIP_PLANES, 4), np.float32)
    discs = (as_float32(points), as_float32(normals), as_float32(radii), neighbors)

    def clip(begin: int, end: int) -> None:
        call("z2p_disc_clip_planes", *discs, begin, end, neighbors.shape[1], planes)

    parallel_rows(clip, len(points))
    return planes


@dataclass(frozen=True)
class Discs:
    """M surfels in the camera's axes, as `rasterize_surfels` draws them. Arrays are float32.

    Attributes:
        centers: (M, 3), relative to the camera's position.
        normals: (M, 3), unit length, facing the camera.
        radii: (M,), world units.
        clip_planes: (M, 4, 4), see `disc_clip_planes`.
    """

    centers: np.ndarray
    normals: np.ndarray
    radii: np.ndarray
    clip_planes: np.ndarray


def fit_disc_textures(
    discs: Discs, neighbors: np.ndarray, albedo: np.ndarray, offset: np.ndarray, slope: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Textures (M, `TEXTURE_VALUES`) float32 of M discs, of offset + slope * albedo, for `rasterize_surfels`.

    Where the nearest discs have two colors, one lies on either side of a curve; elsewhere colors change linearly.

    Args:
        discs: M discs.
        neighbors: (M, K) int32, indices of the nearest discs, nearest first; up to 16 count.
        albedo: (M, 3), at the discs' centers.
        offset: (M, 3), what does not depend on the albedo.
        slope: (M, 3), what does, for each unit of it.
    """
    textures = np.empty((len(discs.centers), TEXTURE_VALUES), np.float32)
    geometry = (as_float32(discs.centers), as_float32(discs.normals), as_float32(discs.radii), neighbors)
    colors = (as_float32(albedo), as_float32(offset), as_float32(slope))

    def fit(begin: int, end: int) -> None:
        call("z2p_fit_disc_textures", *geometry, *colors, begin, end, neighbors.shape[1], textures)

    parallel_rows(fit, len(textures))
    return textures


@dataclass(frozen=True)
class Blending:
    """How overlapping discs become a pixel.

    Attributes:
        blend_depth_radii: discs this far behind the nearest one are still visible, in units of their own radius.
        coverage_gain: coverage is 1 - exp(-coverage_gain w).
        full_weight: density is w / full_weight, at most 1.
        opaque_weight: where a disc's weight is less, near its rim, it hides nothing behind it.
    """

    blend_depth_radii: float
    coverage_gain: float
    full_weight: float
    opaque_weight: float = 0.0


def rasterize_surfels(
    discs: Discs, features: np.ndarray, camera: Camera, blending: Blending, depth_range: tuple[float, float],
    out: np.ndarray, rows: tuple[int, int] | None = None, textures: np.ndarray | None = None,
    colors_out: np.ndarray | None = None,
) -> None:  # fmt: skip
    """Draws discs into `out` (9, H, W) float32: coverage, density, depth and six features; 0 where there is none.

    A pixel has 2 x 2 samples. At each sample a disc has a weight, which falls from 1 at its center to 0 at its rim; w
    is the sum of the weights of the visible discs. Features, density and depth are means over the samples, weighted by
    their coverage (after Zwicker et al., Surface Splatting, 2001).

    Args:
        discs: M discs.
        features: (M, 6), averaged over the discs that a sample shows.
        camera: gives size, focal lengths and principal point of the image.
        blending: what the weights mean.
        depth_range: the depths that are drawn as 1 and as 0, world units.
        out: C-contiguous.
        rows: the rows to draw, from the first to the last, which is excluded; all by default.
        textures: (M, `TEXTURE_VALUES`), two colors on either side of a curve on each disc, as in
            `c/surfels/disc_texture.h`; None for none.
        colors_out: (3, H, W) float32, C-contiguous, which receives the means of the textures' colors; given with them.

    Raises:
        ValueError: `out` or `colors_out` has another shape or dtype, or is not contiguous.
    """
    first, last = rows or (0, camera.height)
    settings = RasterSettings(
        camera.width, camera.height, first, last, camera.orthographic, *camera.focal_lengths, *camera.principal_point,
        camera.near_plane, blending.blend_depth_radii, blending.coverage_gain, blending.full_weight,
        blending.opaque_weight, *depth_range,
    )  # fmt: skip
    size = (camera.height, camera.width)
    texture_values = colors = None
    if textures is not None and colors_out is not None:
        texture_values, colors = as_float32(textures), check_output(colors_out, (3, *size))
    call(
        "z2p_rasterize_surfels", as_float32(discs.centers), as_float32(discs.normals), as_float32(discs.radii),
        as_float32(discs.clip_planes), as_float32(features), texture_values, len(discs.centers), settings,
        check_output(out, (RASTERIZED.stop, *size)), colors,
    )  # fmt: skip
