"""Bindings of `c/lighting/`: light on a cloud's points and on the floor below it.

N points with unit normals. Arrays are float32 unless said otherwise; others are converted. Lengths are in world units,
z is up, and powers and radiances are linear. Points have two sides: row 0 of an array (2, N) is the side that the
normal points to, row 1 the other one. Grids over the floor are (S, S), row by row along +y, and cover a square that is
centered at x = y = 0.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from z2p_core.camera import Camera
from z2p_core.native.library import (
    FLOAT,
    FLOATS,
    FLOATS_OR_NONE,
    FLOATS_OUT,
    INT,
    INTS,
    INTS_OUT,
    Struct,
    as_float32,
    call,
    check_output,
    declare,
)
from z2p_core.native.screen_view import ScreenView, screen_view
from z2p_core.parallel import parallel_rows

MAX_LIT_POINTS = 0xFFFF
"""Points that `direct_lighting` takes at most: as many as shadow maps can number."""


class FloorLight(ctypes.Structure):
    """The C structure of that name (`c/lighting/floor.h`)."""

    _fields_ = [
        ("height", ctypes.c_float),
        ("half_size", ctypes.c_float),
        ("light_positions", ctypes.c_float * 3 * 4),
        ("light_axis", ctypes.c_float * 3),
        ("light_power", ctypes.c_float),
        ("sky_radiance", ctypes.c_float),
        ("albedo", ctypes.c_float),
    ]


class ShadowMapScale(ctypes.Structure):
    """The C structure of that name (`c/lighting/shadow_map.c`)."""

    _fields_ = [("spacing", ctypes.c_float), ("cell_size", ctypes.c_float), ("cloud_radius", ctypes.c_float)]


class OcclusionGrid(ctypes.Structure):
    """The C structure of that name (`c/lighting/floor_occlusion.c`)."""

    _fields_ = [
        ("height", ctypes.c_float),
        ("half_size", ctypes.c_float),
        ("ball_radius_cells", ctypes.c_float),
        ("eroded_share", ctypes.c_float),
        ("side", ctypes.c_int),
        ("blur_cells", ctypes.c_int),
    ]


class FloorShadowView(ctypes.Structure):
    """The C structure of that name (`c/lighting/floor_shadow.c`)."""

    _fields_ = [
        ("rotation", ctypes.c_float * 3 * 3),
        ("position", ctypes.c_float * 3),
        ("focal", ctypes.c_float),
        ("width", ctypes.c_int),
        ("height", ctypes.c_int),
        ("occlusion_side", ctypes.c_int),
        ("reflection_side", ctypes.c_int),
        ("cloud_side", ctypes.c_int),
    ]


FLOOR = Struct(FloorLight)

declare(
    "z2p_direct_lighting", points=FLOATS, normals=FLOATS, count=INT, caster_positions=FLOATS, caster_owners=INTS,
    caster_count=INT, light_positions=FLOATS, light_axes=FLOATS, light_powers=FLOATS, light_count=INT,
    scale=Struct(ShadowMapScale), irradiance=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_first_visible", points=FLOATS, normals=FLOATS, count=INT, axes=FLOATS, axis_count=INT, spacing=FLOAT,
    radius=FLOAT, visible=INTS_OUT,
)  # fmt: skip
declare(
    "z2p_gather_environment", points=FLOATS, normals=FLOATS, count=INT, begin=INT, end=INT, axes=FLOATS, axis_count=INT,
    visible=INTS, floor=FLOOR, light_occlusion=FLOATS, sky_occlusion=FLOATS, side=INT, radiance=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_gather_indirect", points=FLOATS, normals=FLOATS, count=INT, begin=INT, end=INT, axes=FLOATS, axis_count=INT,
    visible=INTS, floor=FLOOR, floor_irradiance=FLOATS, side=INT, radiance=FLOATS, indirect=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_gather_colors", points=FLOATS, normals=FLOATS, count=INT, begin=INT, end=INT, axes=FLOATS, axis_count=INT,
    visible=INTS, floor=FLOOR, floor_irradiance=FLOATS, side=INT, radiance=FLOATS, indirect=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_gather_vectors", points=FLOATS, normals=FLOATS, count=INT, begin=INT, end=INT, axes=FLOATS, axis_count=INT,
    visible=INTS, floor=FLOOR, light_occlusion=FLOATS, sky_occlusion=FLOATS, side=INT, radiance=FLOATS, albedo=FLOAT,
    vectors=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_unshadowed_light", points=FLOATS, normals=FLOATS, begin=INT, end=INT, light_positions=FLOATS,
    light_axes=FLOATS, light_powers=FLOATS, light_count=INT, irradiance=FLOATS_OUT,
)  # fmt: skip
declare("z2p_index_screen", points=FLOATS, count=INT, screen=Struct(ScreenView), index=INTS_OUT)
declare(
    "z2p_fine_occlusion", points=FLOATS, normals=FLOATS, begin=INT, end=INT, index=INTS, screen=Struct(ScreenView),
    radius=FLOAT, light=FLOATS, sky=FLOATS_OUT, direct=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_floor_visibility", points=FLOATS, normals=FLOATS, count=INT, axes=FLOATS, axis_count=INT, floor_height=FLOAT,
    half_size=FLOAT, side=INT, visible=INTS_OUT,
)  # fmt: skip
declare(
    "z2p_floor_irradiance", radiance=FLOATS, count=INT, axis_count=INT, visible=INTS, weight=FLOAT, side=INT,
    irradiance=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_floor_colors", radiance=FLOATS, count=INT, axis_count=INT, visible=INTS, weight=FLOAT, side=INT,
    irradiance=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_floor_occlusion", points=FLOATS, count=INT, samples=FLOATS, sample_count=INT, area_light=FLOATS_OR_NONE,
    grid=Struct(OcclusionGrid), occlusion=FLOATS_OUT,
)  # fmt: skip
declare("z2p_resample_grid", grid=FLOATS, side=INT, new_side=INT, out=FLOATS_OUT)
declare(
    "z2p_floor_shadow", light_occlusion=FLOATS, sky_occlusion=FLOATS, reflection_occlusion=FLOATS,
    cloud_radiance=FLOATS, floor=FLOOR, view=Struct(FloorShadowView), alpha=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_specular_radiance", points=FLOATS, normals=FLOATS, view_dirs=FLOATS, begin=INT, end=INT,
    light_positions=FLOATS, light_count=INT, light_axis=FLOATS, power=FLOAT, alpha_sq=FLOAT, ior=FLOAT,
    specular=FLOATS_OUT, diffuse=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_sharp_light_reflection", points=FLOATS, normals=FLOATS, view_dirs=FLOATS, begin=INT, end=INT, light=FLOATS,
    radiance=FLOAT, blur=FLOAT, ior=FLOAT, specular=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_raycast_discs", points=FLOATS, normals=FLOATS, count=INT, query_indices=INTS, begin=INT, end=INT, rays=FLOATS,
    disc_radius=FLOAT, spacing=FLOAT, radius=FLOAT, hits=INTS_OUT,
)  # fmt: skip


@dataclass(frozen=True)
class ShadowCasters:
    """What casts the shadows of a cloud, for `direct_lighting`.

    Attributes:
        positions: (C, 3).
        owners: (C,), the indices of the points that cast from there; a point is not shadowed by its own surface.
        cell_size: width of a shadow map's cells at the cloud's center.
    """

    positions: np.ndarray
    owners: np.ndarray
    cell_size: float


@dataclass(frozen=True)
class Floor:
    """The floor and the light on it.

    Attributes:
        height: z of the floor.
        half_size: half the length of the sides of its square.
        light_positions: (4, 3), samples of the area light.
        light_axis: (3,), unit axis along which it emits.
        light_power: of all of the light.
        sky_radiance: the same in all directions.
        albedo: diffuse, in [0, 1].
    """

    height: float
    half_size: float
    light_positions: np.ndarray
    light_axis: np.ndarray
    light_power: float
    sky_radiance: float
    albedo: float

    @cached_property
    def struct(self) -> FloorLight:
        """The floor as kernels take it.

        Raises:
            ValueError: an array has another shape.
        """
        positions, axis = np.asarray(self.light_positions, np.float32), np.asarray(self.light_axis, np.float32)
        if positions.shape != (4, 3) or axis.shape != (3,):
            raise ValueError(
                f"expected light positions (4, 3) and a light axis (3,), got {positions.shape} and {axis.shape}"
            )
        struct = FloorLight(
            height=self.height, half_size=self.half_size, light_power=self.light_power,
            sky_radiance=self.sky_radiance, albedo=self.albedo,
        )  # fmt: skip
        np.ctypeslib.as_array(struct.light_positions)[:] = positions
        np.ctypeslib.as_array(struct.light_axis)[:] = axis
        return struct


def direct_lighting(
    points: np.ndarray, normals: np.ndarray, casters: ShadowCasters, light_positions: np.ndarray,
    light_axes: np.ndarray, light_powers: np.ndarray, spacing: float, radius: float,
) -> np.ndarray:  # fmt: skip
    """Irradiance (2, N) of points by an area light, with a shadow map for each of its samples.

    A visible sample contributes power |n_dot_l| cos_at_light / distance^2.

    Args:
        points: (N, 3), N <= `MAX_LIT_POINTS`.
        normals: (N, 3), unit length.
        casters: what casts shadows on the points.
        light_positions: (L, 3); the samples form a square grid, row by row, and every other one's shadows are eroded
            by a cell.
        light_axes: (L, 3), unit axes along which the samples emit.
        light_powers: (L,).
        spacing: mean distance between neighboring points.
        radius: of a sphere about the origin that holds the cloud.

    Raises:
        ValueError: too many points.
    """
    if len(points) > MAX_LIT_POINTS:
        raise ValueError(f"expected at most {MAX_LIT_POINTS} points to light, got {len(points)}")
    irradiance = np.empty((2, len(points)), np.float32)
    call(
        "z2p_direct_lighting", as_float32(points), as_float32(normals), len(points), as_float32(casters.positions),
        np.ascontiguousarray(casters.owners, np.int32), len(casters.positions), as_float32(light_positions),
        as_float32(light_axes), as_float32(light_powers), len(light_positions),
        ShadowMapScale(spacing, casters.cell_size, radius), irradiance,
    )  # fmt: skip
    return irradiance


def first_visible(
    points: np.ndarray, normals: np.ndarray, axes: np.ndarray, spacing: float, radius: float
) -> np.ndarray:
    """Index (2 A, N) int32 of the first point that each point sees along each axis and, in the next row, against it.

    -1 where it sees the environment. Points of its own surface do not count.

    Args:
        points: (N, 3).
        normals: (N, 3), unit length.
        axes: (A, 3), unit length.
        spacing: mean distance between neighboring points.
        radius: of a sphere about the origin that holds the cloud.
    """
    visible = np.empty((2 * len(axes), len(points)), np.int32)
    call(
        "z2p_first_visible", as_float32(points), as_float32(normals), len(points), as_float32(axes), len(axes),
        spacing, radius, visible,
    )  # fmt: skip
    return visible


def gather_environment(
    points: np.ndarray, normals: np.ndarray, axes: np.ndarray, visible: np.ndarray, direct: np.ndarray, floor: Floor,
    light_occlusion: np.ndarray, sky_occlusion: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Radiance (2, N) of white diffuse points under the area light, the sky and the floor that both light.

    Args:
        points: (N, 3).
        normals: (N, 3), unit length.
        axes: (A, 3), unit length, evenly distributed.
        visible: (2 A, N) int32, from `first_visible` for the same axes.
        direct: (2, N), radiance due to the area light alone: irradiance / pi.
        floor: the floor and the light on it.
        light_occlusion: (S, S), from `floor_occlusion` for the area light.
        sky_occlusion: (S, S), for the sky.
    """
    radiance = np.array(direct, np.float32)
    _gather(
        "z2p_gather_environment", points, normals, axes, visible, floor.struct, as_float32(light_occlusion),
        as_float32(sky_occlusion), len(sky_occlusion), radiance,
    )  # fmt: skip
    return radiance


def gather_vectors(
    points: np.ndarray, normals: np.ndarray, axes: np.ndarray, visible: np.ndarray, radiance: np.ndarray, albedo: float,
    floor: Floor, light_occlusion: np.ndarray, sky_occlusion: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Vector irradiance (N, 3): its product with a unit normal near a point's own is the radiance for that normal.

    That is the radiance of a white diffuse point by the sky, the floor that sky and area light light, and other points
    that send `albedo` times the `radiance` (2, N). Other arguments are those of `gather_environment`.
    """
    vectors = np.empty((len(points), 3), np.float32)
    _gather(
        "z2p_gather_vectors", points, normals, axes, visible, floor.struct, as_float32(light_occlusion),
        as_float32(sky_occlusion), len(sky_occlusion), as_float32(radiance), albedo, vectors,
    )  # fmt: skip
    return vectors


def fine_occlusion(
    points: np.ndarray, normals: np.ndarray, camera: Camera, light: np.ndarray, cells_per_pixel: float, radius: float
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Shares (N,) in [0, 1] of the sky, and of the light, that relief near a point leaves visible, as on the screen.

    Args:
        points: (N, 3), in camera axes, relative to the camera's position.
        normals: (N, 3), unit length, facing the camera, in its axes.
        camera: gives the screen.
        light: (3,), the light's position in camera axes, relative to the camera's position.
        cells_per_pixel: cells of the screen along a side of a pixel; few should hold no point.
        radius: distance within which relief hides light, in world units.
    """
    screen = screen_view(camera, 1 / cells_per_pixel)
    cloud, index = (as_float32(points), as_float32(normals)), np.empty((screen.height, screen.width), np.int32)
    call("z2p_index_screen", cloud[0], len(points), screen, index)
    sky, direct = np.empty(len(points), np.float32), np.empty(len(points), np.float32)

    def search(begin: int, end: int) -> None:
        call("z2p_fine_occlusion", *cloud, begin, end, index, screen, radius, as_float32(light), sky, direct)

    parallel_rows(search, len(points))
    return sky, direct


def unshadowed_light(
    points: np.ndarray, normals: np.ndarray, light_positions: np.ndarray, light_axes: np.ndarray,
    light_powers: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Irradiance (N,) of points (N, 3) with unit normals (N, 3) under light samples that nothing hides.

    Args:
        points: (N, 3).
        normals: (N, 3); the side that they point to is lit.
        light_positions: (L, 3).
        light_axes: (L, 3), unit length, along which samples emit.
        light_powers: (L,).
    """
    irradiance = np.empty(len(points), np.float32)
    arrays = [as_float32(array) for array in (points, normals, light_positions, light_axes, light_powers)]

    def add_light(begin: int, end: int) -> None:
        call("z2p_unshadowed_light", *arrays[:2], begin, end, *arrays[2:], len(light_powers), irradiance)

    parallel_rows(add_light, len(points))
    return irradiance


def gather_indirect(
    points: np.ndarray, normals: np.ndarray, axes: np.ndarray, visible: np.ndarray, radiance: np.ndarray, floor: Floor,
    irradiance: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Radiance (2, N) of white diffuse points under each other's light, directly and by way of the floor: one bounce.

    Args:
        points: (N, 3).
        normals: (N, 3), unit length.
        axes: (A, 3), unit length, evenly distributed.
        visible: (2 A, N) int32, from `first_visible` for the same axes.
        radiance: (2, N), what the points send.
        floor: the floor and the light on it.
        irradiance: (S, S), from `floor_irradiance` of that radiance.
    """
    indirect = np.empty((2, len(points)), np.float32)
    _gather(
        "z2p_gather_indirect", points, normals, axes, visible, floor.struct, as_float32(irradiance), len(irradiance),
        as_float32(radiance), indirect,
    )  # fmt: skip
    return indirect


def gather_colors(
    points: np.ndarray, normals: np.ndarray, axes: np.ndarray, visible: np.ndarray, radiance: np.ndarray, floor: Floor,
    irradiance: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """As `gather_indirect`, in three colors and only for the side that normals point to: (N, 3).

    `radiance` is (2, N, 3), and `irradiance` (S, S, 3), from `floor_colors`.
    """
    indirect = np.empty((len(points), 3), np.float32)
    _gather(
        "z2p_gather_colors", points, normals, axes, visible, floor.struct, as_float32(irradiance), len(irradiance),
        as_float32(radiance), indirect,
    )  # fmt: skip
    return indirect


def _gather(
    kernel: str, points: np.ndarray, normals: np.ndarray, axes: np.ndarray, visible: np.ndarray, *rest: Any
) -> None:
    """Calls a gathering kernel for all points, which the cores share."""
    cloud = (as_float32(points), as_float32(normals), len(points))
    directions = (as_float32(axes), len(axes), visible)
    parallel_rows(lambda begin, end: call(kernel, *cloud, begin, end, *directions, *rest), len(points))


def floor_visibility(points: np.ndarray, normals: np.ndarray, axes: np.ndarray, floor: Floor, side: int) -> np.ndarray:
    """Which points the floor's cells see first along each axis: (A, 2, N) int32, for `floor_irradiance`.

    Row 0 has the cells that see a point, ended by -1 if they are fewer than N; row 1 the index into an array (2, N),
    flattened, of the point and the side that is seen.

    Args:
        points: (N, 3).
        normals: (N, 3), unit length.
        axes: (A, 3), unit length, upward.
        floor: gives height and size.
        side: cells along a side of the floor's square.
    """
    visible = np.empty((len(axes), 2, len(points)), np.int32)
    cloud = (as_float32(points), as_float32(normals), len(points))

    def project(begin: int, end: int) -> None:
        call(
            "z2p_floor_visibility", *cloud, as_float32(axes[begin:end]), end - begin, floor.height, floor.half_size,
            side, visible[begin:end],
        )  # fmt: skip

    parallel_rows(project, len(axes), smallest=2)
    return visible


def floor_irradiance(radiance: np.ndarray, visible: np.ndarray, side: int) -> np.ndarray:
    """Irradiance / pi (S, S) that the floor's cells receive from a cloud: the radiance of a white floor.

    Args:
        radiance: (2, N), what the points send.
        visible: (A, 2, N) int32, from `floor_visibility`, whose axes count alike.
        side: S, cells along a side of the floor's square, as in `floor_visibility`.
    """
    irradiance = np.empty((side, side), np.float32)
    axis_count = len(visible)
    call(
        "z2p_floor_irradiance", as_float32(radiance), radiance.shape[1], axis_count, visible, 1 / axis_count, side,
        irradiance,
    )  # fmt: skip
    return irradiance


def floor_colors(radiance: np.ndarray, visible: np.ndarray, side: int) -> np.ndarray:
    """As `floor_irradiance`, in three colors: (S, S, 3) of radiance (2, N, 3)."""
    irradiance = np.empty((side, side, 3), np.float32)
    axis_count = len(visible)
    call(
        "z2p_floor_colors", as_float32(radiance), radiance.shape[1], axis_count, visible, 1 / axis_count, side,
        irradiance,
    )  # fmt: skip
    return irradiance


def floor_occlusion(
    points: np.ndarray, light_samples: np.ndarray, floor_height: float, half_size: float, side: int,
    eroded_share: float = 0.25, ball_radius: float = 0, blur_cells: int = 0, area_light: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Share (S, S), in [0, 1], of the light samples that points hide from each cell of the floor.

    Args:
        points: (N, 3).
        light_samples: (L, 3), L <= 64, positions. Samples below the floor are cameras mirrored in it: a point then
            hides what the camera would see reflected.
        floor_height: z of the floor.
        half_size: half the length of the sides of the floor's square.
        side: S, cells along a side.
        eroded_share: shadows of this share of the samples are a cell narrower, in [0, 1]; all cells that a shadow
            touches are in it.
        ball_radius: of the points, where a low or near light sample elongates their shadows.
        blur_cells: the result is averaged over so many cells to every side.
        area_light: (3, 3), center and edge vectors of a square light that the samples are the 8 x 8 parts of. Each
            then counts by the light that it gives a cell, and averaging only smooths the steps of penumbrae.
    """
    occlusion = np.empty((side, side), np.float32)
    grid = OcclusionGrid(
        height=floor_height, half_size=half_size, ball_radius_cells=ball_radius * side / (2 * half_size),
        eroded_share=eroded_share, side=side, blur_cells=blur_cells,
    )  # fmt: skip
    call(
        "z2p_floor_occlusion", as_float32(points), len(points), as_float32(light_samples), len(light_samples),
        None if area_light is None else as_float32(area_light), grid, occlusion,
    )  # fmt: skip
    return occlusion


def resample_grid(grid: np.ndarray, side: int) -> np.ndarray:
    """A grid (S, S), S > 1, over the same square with other cells: (side, side), linear between cell centers."""
    if len(grid) == side:
        return grid
    out = np.empty((side, side), np.float32)
    call("z2p_resample_grid", as_float32(grid), len(grid), side, out)
    return out


def floor_shadow(
    light_occlusion: np.ndarray, sky_occlusion: np.ndarray, reflection_occlusion: np.ndarray,
    cloud_radiance: np.ndarray, floor: Floor, camera: Camera, out: np.ndarray,
) -> None:  # fmt: skip
    """Draws into `out` (H, W) float32 the alpha of the shadow on the floor as the camera sees it, in [0, 1].

    It is the share of the floor's radiance that is missing; 0 above the horizon.

    Args:
        light_occlusion: (S, S), from `floor_occlusion` for the area light.
        sky_occlusion: (S, S), for the sky.
        reflection_occlusion: (R, R), for what the floor reflects.
        cloud_radiance: (G, G), mean radiance of the cloud as seen from the floor's cells.
        floor: the floor and the light on it.
        camera: its x axis is horizontal.
        out: C-contiguous.

    Raises:
        ValueError: `out` has another shape or dtype, or is not contiguous.
    """
    view = FloorShadowView(
        focal=camera.focal, width=camera.width, height=camera.height, occlusion_side=len(sky_occlusion),
        reflection_side=len(reflection_occlusion), cloud_side=len(cloud_radiance),
    )  # fmt: skip
    np.ctypeslib.as_array(view.rotation)[:] = camera.rotation
    np.ctypeslib.as_array(view.position)[:] = camera.position
    call(
        "z2p_floor_shadow", as_float32(light_occlusion), as_float32(sky_occlusion), as_float32(reflection_occlusion),
        as_float32(cloud_radiance), floor.struct, view, check_output(out, (camera.height, camera.width)),
    )  # fmt: skip


def specular_radiance(
    points: np.ndarray, normals: np.ndarray, view_dirs: np.ndarray, light_positions: np.ndarray,
    light_axis: np.ndarray, power: float, alpha: float, ior: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Radiance that GGX surfaces reflect from unoccluded light samples to the viewer, and that diffuse ones send.

    The BRDF is D F G2 / (4 n_dot_l n_dot_v), with the height-correlated Smith term (Heitz, 2014).

    Args:
        points: (M, 3).
        normals: (M, 3), unit length.
        view_dirs: (M, 3), unit vectors to the viewer.
        light_positions: (L, 3).
        light_axis: (3,), unit axis along which the samples emit.
        power: of each sample.
        alpha: GGX roughness, in (0, 1].
        ior: index of refraction of the dielectric, above 1.

    Returns:
        GGX terms (M, 3): the radiance with F = 1; the same weighted by Schlick's (1 - v_dot_h)^5; and weighted by the
        dielectric's Fresnel reflectance, normalized to 0 at normal and 1 at grazing incidence. With F = f0 +
        (f90 - f0) w, the reflected radiance is f0 (term 0 - term w) + f90 term w. And the radiance (M,) of a white
        diffuse surface.
    """
    specular, diffuse = np.empty((len(points), 3), np.float32), np.empty(len(points), np.float32)
    surface = (as_float32(points), as_float32(normals), as_float32(view_dirs))
    light = (as_float32(light_positions), len(light_positions), as_float32(light_axis), power)

    def shade(begin: int, end: int) -> None:
        call("z2p_specular_radiance", *surface, begin, end, *light, alpha**2, ior, specular, diffuse)

    parallel_rows(shade, len(points))
    return specular, diffuse


def sharp_light_reflection(
    points: np.ndarray, normals: np.ndarray, view_dirs: np.ndarray, light: np.ndarray, radiance: float, blur: float,
    ior: float,
) -> np.ndarray:  # fmt: skip
    """GGX terms (M, 3) as of `specular_radiance`, of surfaces so smooth that they mirror a square light's outline.

    Args:
        points: (M, 3).
        normals: (M, 3), unit length.
        view_dirs: (M, 3), unit vectors to the viewer.
        light: (3, 3), the square's center and its two edge vectors; it emits towards the origin.
        radiance: of the light.
        blur: standard deviation of the blur of its edges, over the distance to it.
        ior: index of refraction of the dielectric, above 1.
    """
    specular = np.empty((len(points), 3), np.float32)
    surface = (as_float32(points), as_float32(normals), as_float32(view_dirs))
    rest = (as_float32(light), radiance, blur, ior, specular)
    parallel_rows(lambda begin, end: call("z2p_sharp_light_reflection", *surface, begin, end, *rest), len(points))
    return specular


def raycast_discs(
    points: np.ndarray, normals: np.ndarray, query_indices: np.ndarray, rays: np.ndarray, disc_radius: float,
    spacing: float, radius: float,
) -> np.ndarray:  # fmt: skip
    """Index (M,) int32 of the point whose disc the ray from each queried point hits first; -1 for none.

    Discs lie across the points' normals; a point's own surface is not hit.

    Args:
        points: (N, 3).
        normals: (N, 3), unit length.
        query_indices: (M,), the points where rays begin.
        rays: (M, 3), unit directions.
        disc_radius: of all points.
        spacing: mean distance between neighboring points.
        radius: of a sphere about the origin that holds the cloud.
    """
    hits, query_indices = np.empty(len(query_indices), np.int32), np.ascontiguousarray(query_indices, np.int32)
    cloud = (as_float32(points), as_float32(normals), len(points), query_indices)
    rest = (as_float32(rays), disc_radius, spacing, radius, hits)
    parallel_rows(lambda begin, end: call("z2p_raycast_discs", *cloud, begin, end, *rest), len(query_indices), parts=2)
    return hits
