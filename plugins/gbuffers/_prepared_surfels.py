"""A cloud's surfels for many images: what depends neither on the camera nor on the light is computed once.

The cloud stays where it is; camera and light are turned around it. Three layers are kept, each as long as what it
depends on stays the same:

1. `SurfelGeometry`, which depends on the cloud alone;
2. `FloorView`: who sees whom, and how much of the sky the cloud hides from the floor, which depends on its height too;
3. `LightField`: depends on where the light is around the cloud; the newest one is kept.

Light is kept with the normals as they were estimated, and has a value for both sides of a point. For an image, normals
that point away from the camera are flipped, and the two values of those points change places.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from threading import Lock
from typing import ClassVar, Protocol

import numpy as np

from z2p_core import native
from z2p_core.camera import Camera, TurnedCamera
from z2p_core.interfaces import PointColors, PreparedCloud
from z2p_core.linalg import row_dots
from z2p_core.scene import SceneDescription
from z2p_core.shading.channels import GBufferChannel
from z2p_core.shading.floor_occlusion import FloorOcclusion
from z2p_core.shading.light_transport import (
    BouncedLight,
    LightField,
    LightScene,
    Quality,
    begin_floor_visibility,
    begin_point_visibility,
    bounce_light,
    direct_radiance,
    floor_light_stride,
)
from z2p_core.shading.textured_light import surface_albedo
from z2p_renderer.plugins.gbuffers._detail import Detail, visible_detail
from z2p_renderer.plugins.gbuffers._drawing import (
    SeenPoints,
    SurfelGeometry,
    light_sample_sets,
    light_scene,
    project_surfels,
)

AZIMUTH_DIGITS = 6
"""Decimals of degrees to which a light's azimuth around the cloud is rounded, so that a light fixed to it is the same
light in every image."""


@dataclass(frozen=True)
class FloorView:
    """What lights above a floor of one height share."""

    height: float
    seen: SeenPoints
    casters: native.ShadowCasters


@dataclass(frozen=True)
class KeptLight:
    """A light field, and what it is the light of."""

    key: tuple[object, ...]
    field: LightField
    floor: FloorView


class Phases(Protocol):
    """The phases of a G-buffer's drawing that need what is kept; see `Surfels`."""

    quality: ClassVar[Quality]

    def casters(self, geometry: SurfelGeometry, spacing: float) -> native.ShadowCasters: ...

    def occlude_floor(
        self, lit: LightScene, casters: native.ShadowCasters, sets: int, sky: np.ndarray | None = None
    ) -> FloorOcclusion: ...  # fmt: skip

    def draw_lit(
        self, out: np.ndarray, geometry: SurfelGeometry, detail: Detail | None, discs: native.Discs, field: LightField,
        seen: SeenPoints, camera: Camera, scene: SceneDescription, albedo: np.ndarray | None,
        colors_out: np.ndarray | None,
    ) -> None: ...  # fmt: skip


class PreparedSurfels(PreparedCloud):
    """A cloud that `Surfels`, or a G-buffer built on it, draws again and again."""

    def __init__(
        self, gbuffer: Phases, cloud: np.ndarray, geometry: SurfelGeometry, colors: PointColors | None
    ) -> None:  # fmt: skip
        """`geometry` is that of the cloud (N, 3), of which it may have fewer points."""
        self._surfels, self._cloud, self._geometry, self._colors = gbuffer, cloud, geometry, colors
        self._lowest = float(cloud[:, 2].min())
        self._albedo = None if colors is None else surface_albedo(geometry.surface, colors)
        self._lock = Lock()
        self._floor: FloorView | None = None
        self._light: KeptLight | None = None

    def recolored(self, colors: PointColors | None) -> PreparedSurfels:
        other = PreparedSurfels(self._surfels, self._cloud, self._geometry, colors)
        with self._lock:
            other._floor, other._light = self._floor, self._light
        return other

    def draw_into(
        self, out: np.ndarray, azimuth: float, camera: Camera, scene: SceneDescription
    ) -> np.ndarray | None:  # fmt: skip
        turned = TurnedCamera(camera.width, camera.height, camera.elevation, -azimuth)
        radius, light_azimuth, elevation = scene.light
        around = round((light_azimuth - azimuth) % 360.0, AZIMUTH_DIGITS) % 360.0
        scene = replace(scene, light=(radius, around, elevation))
        with self._lock:
            kept = self._light_of(scene, light_sample_sets(camera))
        geometry, relative = self._geometry, None
        if self._albedo is not None:
            relative = np.zeros((4, camera.height, camera.width), np.float32)
        detail = visible_detail(self._cloud, geometry.surface, geometry.spacing, turned, self._colors)
        discs = project_surfels(geometry, detail, turned)
        flipped = faces_away(geometry, turned.position)
        field = flip_sides(kept.field, flipped)
        seen = kept.floor.seen
        if self._albedo is not None:  # without colors only the cells that see points matter, not the points' sides
            seen = replace(seen, by_floor=flip_seen(seen.by_floor, flipped[:: floor_light_stride(len(flipped))]))
        self._surfels.draw_lit(out, geometry, detail, discs, field, seen, turned, scene, self._albedo,
                               None if relative is None else relative[:3])  # fmt: skip
        if relative is not None:
            relative[3] = out[GBufferChannel.COVERAGE]
        return relative

    def _light_of(self, scene: SceneDescription, sets: int) -> KeptLight:
        """The scene's light on the cloud: the kept one if that is the same. Called under the lock."""
        height = self._lowest if scene.floor is None else scene.floor
        key = (scene.light, height, sets)
        if self._light is not None and self._light.key == key:
            return self._light
        surface, quality = self._geometry.surface, self._surfels.quality
        lit = light_scene(surface, surface.normals, self._geometry.spacing, scene, height)
        floor, sky = self._floor_of(lit), None
        if self._light is not None and self._light.floor is floor:
            sky = self._light.field.occlusion.sky
        direct = direct_radiance(lit, floor.casters)
        occlusion: FloorOcclusion = self._surfels.occlude_floor(lit, floor.casters, sets, sky)
        bounced = bounce_light(lit, direct, occlusion, floor.seen.by_points, floor.seen.by_floor, quality)
        self._light = KeptLight(key, LightField(lit, direct, occlusion, bounced), floor)
        return self._light

    def _floor_of(self, lit: LightScene) -> FloorView:
        """What does not depend on the light: the kept one if the floor's height is the same. Called under the lock."""
        if self._floor is not None and self._floor.height == lit.floor.height:
            return self._floor
        quality, kept = self._surfels.quality, self._floor
        by_points = None if kept is None else kept.seen.by_points
        pending = begin_point_visibility(lit, quality) if by_points is None else None
        by_floor = begin_floor_visibility(lit, quality)
        casters = self._surfels.casters(self._geometry, lit.spacing) if kept is None else kept.casters
        if pending is not None:
            by_points = pending.result()
        assert by_points is not None
        self._floor = FloorView(lit.floor.height, SeenPoints(by_points, by_floor.result()), casters)
        return self._floor


def faces_away(geometry: SurfelGeometry, viewer: np.ndarray) -> np.ndarray:
    """Which normals (N,) of the geometry's points, as they were estimated, point away from a viewer (3,)."""
    surface = geometry.surface
    away: np.ndarray = row_dots(surface.points - viewer.astype(np.float32), surface.normals) > 0
    return away


def flip_sides(field: LightField, flipped: np.ndarray) -> LightField:
    """The same light with some points' normals (N,) flipped, so that their sides change places."""
    sign = np.where(flipped, np.float32(-1), np.float32(1))[:, None]
    scene = replace(field.scene, normals=field.scene.normals * sign)
    bounced = BouncedLight([swap_rows(sides, flipped) for sides in field.bounced.points], field.bounced.floor)
    return LightField(scene, swap_rows(field.direct, flipped), field.occlusion, bounced)


def swap_rows(sides: np.ndarray, swapped: np.ndarray) -> np.ndarray:
    """Values (2, N) with rows exchanged in the columns that are `swapped` (N,)."""
    return np.where(swapped, sides[::-1], sides)


def flip_seen(by_floor: np.ndarray, flipped: np.ndarray) -> np.ndarray:
    """`begin_floor_visibility`'s indices (A, 2, M) into both sides of M points, some of whose normals are flipped."""
    count = len(flipped)
    own, other = np.arange(count, dtype=np.int32), np.arange(count, 2 * count, dtype=np.int32)
    index = np.concatenate([np.where(flipped, other, own), np.where(flipped, own, other)])
    seen = by_floor.copy()
    cells, sides = by_floor[:, 0], by_floor[:, 1]
    used = np.cumprod(cells >= 0, axis=1, dtype=bool)  # a row ends with its first cell of -1; what follows is not set
    seen[:, 1] = np.where(used, index[np.where(used, sides, 0)], sides)
    return seen
