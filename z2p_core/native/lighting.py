"""Kernels of light on a cloud's points and on the floor below it."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
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
from z2p_core.parallel import parallel_rows


class FloorStruct(ctypes.Structure):
    """The C structure `Floor` (`c/lighting/floor.h`)."""

    _fields_ = [
        ("height", ctypes.c_float),
        ("half", ctypes.c_float),
        ("lamps", ctypes.c_float * 3 * 4),
        ("axis", ctypes.c_float * 3),
        ("power", ctypes.c_float),
        ("sky", ctypes.c_float),
        ("albedo", ctypes.c_float),
    ]


class ShadowMapScale(ctypes.Structure):
    """The C structure of that name (`c/lighting/shadow_map.c`)."""

    _fields_ = [("spacing", ctypes.c_float), ("cell_size", ctypes.c_float), ("cloud_radius", ctypes.c_float)]


FLOOR = Struct(FloorStruct, "Floor")

declare(
    "z2p_raycast_discs", points=FLOATS, normals=FLOATS, count=INT, query_indices=INTS, begin=INT, end=INT, rays=FLOATS,
    disc_radius=FLOAT, spacing=FLOAT, radius=FLOAT, hits=INTS_OUT,
)  # fmt: skip
declare(
    "z2p_floor_shade", points=FLOATS, count=INT, lamps=FLOATS, lamp_count=INT, square=FLOATS_OR_NONE, floor=FLOAT,
    half=FLOAT, side=INT, ball=FLOAT, narrowed=FLOAT, soft=INT, shade=FLOATS_OUT,
)  # fmt: skip
declare("z2p_other_cells", grid=FLOATS, side=INT, wide=INT, out=FLOATS_OUT)
declare(
    "z2p_floor_shadow", lamp_shade=FLOATS, sky_shade=FLOATS, side=INT, mirror_shade=FLOATS, half_side=INT, cloud=FLOATS,
    coarse=INT, floor=FLOOR, rotation=FLOATS, place=FLOATS, focal=FLOAT, width=INT, height=INT,
    alpha=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_gloss", points=FLOATS, normals=FLOATS, towards=FLOATS, begin=INT, end=INT, lamps=FLOATS, lamp_count=INT,
    axis=FLOATS, power=FLOAT, square=FLOAT, index=FLOAT, shine=FLOATS_OUT, matt=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_image", points=FLOATS, normals=FLOATS, towards=FLOATS, begin=INT, end=INT, light=FLOATS, radiance=FLOAT,
    blur=FLOAT, index=FLOAT, shine=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_gather_open", points=FLOATS, normals=FLOATS, count=INT, begin=INT, end=INT, axes=FLOATS, axis_count=INT,
    hit=INTS, floor=FLOOR, lamp_shade=FLOATS, sky_shade=FLOATS, side=INT, light=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_gather_bounced", points=FLOATS, normals=FLOATS, count=INT, begin=INT, end=INT, axes=FLOATS, axis_count=INT,
    hit=INTS, floor=FLOOR, glow=FLOATS, side=INT, light=FLOATS, bounced=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_floor_hits", points=FLOATS, normals=FLOATS, count=INT, axes=FLOATS, axis_count=INT, floor=FLOAT, half=FLOAT,
    side=INT, seen=INTS_OUT,
)  # fmt: skip
declare("z2p_floor_glow", light=FLOATS, count=INT, axis_count=INT, seen=INTS, share=FLOAT, side=INT, glow=FLOATS_OUT)
declare(
    "z2p_direct_lighting", points=FLOATS, normals=FLOATS, count=INT, caster_positions=FLOATS, caster_owners=INTS,
    caster_count=INT, light_positions=FLOATS, light_axes=FLOATS, light_powers=FLOATS, light_count=INT,
    scale=Struct(ShadowMapScale), irradiance=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_first_visible", points=FLOATS, normals=FLOATS, count=INT, axes=FLOATS, axis_count=INT, spacing=FLOAT,
    radius=FLOAT, visible=INTS_OUT,
)  # fmt: skip

MOST_LIT = 0xFFFF
"""Points whose numbers fit into shadow maps."""


@dataclass(frozen=True)
class Casters:
    """What of a cloud casts its shadows: places (C, 3), of the points with those numbers (C,).

    Shadows are kept in cells of about that width, in world units.
    """

    places: np.ndarray
    owners: np.ndarray
    cell: float


@dataclass(frozen=True)
class Floor:
    """The floor's square and the light on it, in world units."""

    height: float
    half: float
    """How far it reaches to every side of the origin."""
    lamps: np.ndarray
    """Four places (4, 3) that stand for the light, which shines along its unit axis (3,)."""
    axis: np.ndarray
    power: float
    sky: float
    """Radiance of the sky."""
    albedo: float

    @property
    def struct(self) -> FloorStruct:
        """The fields as the kernels read them."""
        lamps, axis = np.asarray(self.lamps, np.float32), np.asarray(self.axis, np.float32)
        floor = FloorStruct(self.height, self.half, power=self.power, sky=self.sky, albedo=self.albedo)
        np.ctypeslib.as_array(floor.lamps)[:] = lamps
        np.ctypeslib.as_array(floor.axis)[:] = axis
        return floor


def direct_lighting(
    points: np.ndarray, normals: np.ndarray, casters: Casters, lamps: np.ndarray, axes: np.ndarray, powers: np.ndarray,
    spacing: float, radius: float,
) -> np.ndarray:  # fmt: skip
    """Light (2, N) on points (N, 3) with normals: what of lamps (L, 3) that shine along unit axes (L, 3) reaches them.

    A lamp of power p gives p cos cos / distance^2 where the casters of the cloud, of that spacing and within `radius`
    of the origin, do not hide it: to the side that the normal points to, row 0, or to the other one. The shadows of
    every other one of the lamps, which stand in a square, row by row, are a cell narrower.

    Raises:
        ValueError: more points than shadow maps can number.
    """
    if len(points) > MOST_LIT:
        raise ValueError(f"expected at most {MOST_LIT} points to light, got {len(points)}")
    light = np.empty((2, len(points)), np.float32)
    call(
        "z2p_direct_lighting", as_float32(points), as_float32(normals), len(points), as_float32(casters.places),
        np.ascontiguousarray(casters.owners, np.int32), len(casters.places), as_float32(lamps), as_float32(axes),
        as_float32(powers), len(lamps), ShadowMapScale(spacing, casters.cell, radius), light,
    )  # fmt: skip
    return light


def floor_shade(
    points: np.ndarray, lamps: np.ndarray, floor: float, half: float, side: int, narrowed: float = 0.25,
    ball: float = 0, soft: int = 0, square: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Shade (side, side) on a square floor at that height, `half` to each side of the origin; row by row along +Y.

    Each cell has the share of the lamps (L, 3), L <= 64, that points (N, 3) hide from it, on average over `soft` cells
    to every side. Lamps below the floor are eyes that look into it as into a mirror. Cells that a shadow only touches
    are in it; of the share `narrowed` of the lamps shadows are a cell narrower. Where a low or near lamp draws their
    shadows out, points are balls of radius `ball`, in world units. `square` (3, 3), the middle and the two sides
    of a square light whose 8 x 8 parts the lamps are, weighs each part by how much it shines on the cell, and the
    average is only taken as far as steps in its penumbra ask for it.
    """
    shade = np.empty((side, side), np.float32)
    call(
        "z2p_floor_shade", as_float32(points), len(points), as_float32(lamps), len(lamps),
        None if square is None else as_float32(square), floor, half, side,
        ball * side / (2 * half), narrowed, soft, shade,
    )  # fmt: skip
    return shade


def in_other_cells(shade: np.ndarray, side: int) -> np.ndarray:
    """Shade (S, S), S > 1, on the same floor in `side` cells a side: (side, side), linear between cells' centres."""
    if len(shade) == side:
        return shade
    out = np.empty((side, side), np.float32)
    call("z2p_other_cells", as_float32(shade), len(shade), side, out)
    return out


def first_visible(points: np.ndarray, normals: np.ndarray, axes: np.ndarray, spacing: float, radius: float) -> np.ndarray:
    """The point (2 A, N) int32 that each of points (N, 3) sees first along unit axes (A, 3), and against each.

    -1 where the view is free. The cloud has that spacing and lies within `radius` of the origin.
    """
    hits = np.empty((2 * len(axes), len(points)), np.int32)
    call(
        "z2p_first_visible", as_float32(points), as_float32(normals), len(points), as_float32(axes), len(axes),
        spacing, radius, hits,
    )  # fmt: skip
    return hits


def raycast_discs(
    points: np.ndarray, normals: np.ndarray, asked: np.ndarray, rays: np.ndarray, reach: float, spacing: float,
    radius: float,
) -> np.ndarray:  # fmt: skip
    """The point (M,) int32 that each of those asked for (M,) sees first along its own unit ray (M, 3); -1 for none.

    Points (N, 3) are discs of radius `reach` across their normals; the point's own surface is not seen. The cloud has
    that spacing and lies within `radius` of the origin.
    """
    hits, asked = np.empty(len(asked), np.int32), np.ascontiguousarray(asked, np.int32)
    cloud = (as_float32(points), as_float32(normals), len(points), asked)
    rest = (as_float32(rays), reach, spacing, radius, hits)
    parallel_rows(lambda begin, end: call("z2p_raycast_discs", *cloud, begin, end, *rest), len(asked), parts=2)
    return hits


def gloss(
    points: np.ndarray, normals: np.ndarray, towards: np.ndarray, lamps: np.ndarray, axis: np.ndarray, power: float,
    alpha: float, index: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """What surfaces at points (M, 3) with unit normals (M, 3) send of lamps in unit directions (M, 3).

    As radiances (M, 3): what one of roughness `alpha` mirrors (GGX), if it mirrored all; and that by how far what metal
    reflects rises to a grazing angle, and plastic of that index of refraction. And what a matt white one sends (M,).
    Nothing hides the lamps (L, 3), which shine along a unit axis (3,), each with that power.
    """
    shine, matt = np.empty((len(points), 3), np.float32), np.empty(len(points), np.float32)
    seen = (as_float32(points), as_float32(normals), as_float32(towards))
    rest = (as_float32(lamps), len(lamps), as_float32(axis), power, alpha**2, index, shine, matt)
    parallel_rows(lambda begin, end: call("z2p_gloss", *seen, begin, end, *rest), len(points))
    return shine, matt


def image(
    points: np.ndarray, normals: np.ndarray, towards: np.ndarray, light: np.ndarray, radiance: float, blur: float,
    index: float,
) -> np.ndarray:  # fmt: skip
    """The same radiances (M, 3) of surfaces so smooth that they show a square light's image.

    `light` (3, 3) is its middle and its two sides; it shines towards the origin. The image's edges are blurred by
    `blur` of the way to it, a standard deviation.
    """
    shine = np.empty((len(points), 3), np.float32)
    seen = (as_float32(points), as_float32(normals), as_float32(towards))
    rest = (as_float32(light), radiance, blur, index, shine)
    parallel_rows(lambda begin, end: call("z2p_image", *seen, begin, end, *rest), len(points))
    return shine


def gather_open(
    points: np.ndarray, normals: np.ndarray, axes: np.ndarray, hits: np.ndarray, direct: np.ndarray, floor: Floor,
    lamp_shade: np.ndarray, sky_shade: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Radiance (2, N) of a white diffuse cloud under lamps, sky and the floor that they light, on both sides.

    `direct` (2, N) is what comes straight from the lamps, as a radiance; `hits` those of `first_visible`; the shades
    (S, S) those of `floor_shade`.
    """
    light = np.array(direct, np.float32)
    _gather(
        "z2p_gather_open", points, normals, axes, hits, floor.struct, as_float32(lamp_shade), as_float32(sky_shade),
        len(sky_shade), light,
    )  # fmt: skip
    return light


def gather_bounced(
    points: np.ndarray, normals: np.ndarray, axes: np.ndarray, hits: np.ndarray, light: np.ndarray, floor: Floor,
    glow: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Radiance (2, N) that white diffuse points get from each other, and once more from the floor that they light.

    `light` (2, N) is what they send back on both sides; `hits` those of `first_visible`; `glow` (G, G) that light's
    `floor_glow`. Of points with an albedo it is so much for each time that the cloud sent it on.
    """
    bounced = np.empty((2, len(points)), np.float32)
    _gather(
        "z2p_gather_bounced", points, normals, axes, hits, floor.struct, as_float32(glow), len(glow), as_float32(light),
        bounced,
    )  # fmt: skip
    return bounced


def floor_hits(points: np.ndarray, normals: np.ndarray, axes: np.ndarray, floor: Floor, side: int) -> np.ndarray:
    """What the cells of the floor's (side, side) see first along each axis (A, 3): (A, 2, N) int32.

    In row 0 the cells that see one of points (N, 3), ended by -1 where that are not all; in row 1 where the light of
    what they see lies in a cloud's (2, N), by normals (N, 3). Unit axes go up.
    """
    seen = np.empty((len(axes), 2, len(points)), np.int32)

    def find(begin: int, end: int) -> None:
        call(
            "z2p_floor_hits", *cloud, as_float32(axes[begin:end]), end - begin, floor.height,
            floor.half, side, seen[begin:end],
        )  # fmt: skip

    cloud = (as_float32(points), as_float32(normals), len(points))
    parallel_rows(find, len(axes), smallest=2)
    return seen


def floor_glow(light: np.ndarray, seen: np.ndarray, side: int) -> np.ndarray:
    """What the floor's cells (side, side) see of a cloud, as the radiance of a white floor.

    `light` (2, N) is the cloud's radiance on both sides; `seen` (A, 2, N) is that of `floor_hits`, whose axes count
    alike.
    """
    glow = np.empty((side, side), np.float32)
    count = len(seen)
    call("z2p_floor_glow", as_float32(light), light.shape[1], count, seen, 1 / count, side, glow)
    return glow


def floor_shadow(
    lamp_shade: np.ndarray, sky_shade: np.ndarray, mirror_shade: np.ndarray, cloud: np.ndarray, floor: Floor,
    camera: Camera, out: np.ndarray,
) -> None:  # fmt: skip
    """Draws into `out` (H, W) the alpha of the shadow on the floor as the camera sees it, 0 above the horizon.

    The shades are those of `floor_shade`: for the lamp and for the sky (S, S), and for what the floor mirrors (M, M).
    `cloud` (G, G) is the cloud's mean radiance as seen from the floor.
    """
    call(
        "z2p_floor_shadow", as_float32(lamp_shade), as_float32(sky_shade), len(sky_shade), as_float32(mirror_shade),
        len(mirror_shade), as_float32(cloud), len(cloud), floor.struct, as_float32(camera.rotation), as_float32(camera.position),
        camera.focal, camera.width, camera.height, check_output(out, (camera.height, camera.width)),
    )  # fmt: skip


def _gather(
    kernel: str, points: np.ndarray, normals: np.ndarray, axes: np.ndarray, hits: np.ndarray, *rest: Any
) -> None:
    """Calls a kernel that works on rows of points, which two cores share out."""
    count = len(points)
    cloud = (as_float32(points), as_float32(normals), count)
    seen = (as_float32(axes), len(axes), hits)

    def gather(begin: int, end: int) -> None:
        call(kernel, *cloud, begin, end, *seen, *rest)

    parallel_rows(gather, count)
