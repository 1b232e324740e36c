"""Light on a cloud's points and on the floor below it: direct light, then what points and floor send to each other.

The phases are plain functions, to be called in this order; each takes the results of those before it:

1. `LightScene`: the geometry that light falls on;
2. `begin_point_visibility`, `begin_floor_visibility`: a second core starts to find out which points see which;
3. `direct_radiance`: the area light on the points, through shadow maps;
   `z2p_core.shading.floor_occlusion.floor_occlusion`: how much light the cloud takes from the floor;
4. `bounce_light`: light from the sky and the lit floor, and on from point to point;
5. `z2p_core.shading.floor_shadow`: what the camera sees of the floor's shadow.

Arrays of shape (2, N) hold a value for both sides of each point: row 0 for the side that its normal points to, row 1
for the other. Radiances are linear and grey, those of white diffuse surfaces.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from z2p_core import native
from z2p_core.linalg import row_dots
from z2p_core.parallel import begin_parallel_rows
from z2p_core.scene import AMBIENT, DEFAULT_BASE_COLOR, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription
from z2p_core.shading.area_light import area_light_quad, area_light_samples, cosine_hemisphere, hemisphere_axes
from z2p_core.shading.floor_occlusion import FLOOR_HALF_WIDTH, FLOOR_SKY_DIRECTIONS, FloorOcclusion

POINT_LIGHT_SAMPLES = 16
"""Samples of the area light for the light on points, a square number."""
GAUSS_POINTS = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) / math.sqrt(12)
"""Gauss quadrature of a unit square with 2 x 2 points, relative to its center: enough for the floor, where the light
varies slowly."""
IRRADIANCE_CELLS = (128, 192)
"""Fewest and most cells along a side of the floor for the light that it receives from the cloud."""
IRRADIANCE_CELL_SPACINGS = 2.5
"""Width of these cells between the two, in spacings of the points: narrower ones show the points."""
FLOOR_ALBEDO = 0.8
"""Base color of the floor, Blender's default for a surface without a material."""
MAX_FLOOR_LIGHT_POINTS = 20_000
"""Points that send light to the floor: of a larger cloud every n-th point does, in n times as many directions, which
makes that light smoother in the same time."""
BOUNCES = 2
"""How often light is followed from the cloud to the cloud and to the floor."""
MAX_BOUNCE_RATIO = 0.9
"""Largest ratio of one bounce to the one before that is assumed for the bounces which are not computed."""


@dataclass(frozen=True)
class Quality:
    """How many samples light is computed with. They take most of a G-buffer's time, whatever the image's size."""

    sky_axes: int = 24
    """Axes along which each point looks around, in both directions."""
    floor_directions: int = 64
    """Directions in which the floor sees a cloud of at most `MAX_FLOOR_LIGHT_POINTS`."""
    mirror_directions: int = 64
    """Directions in which the floor mirrors the cloud, at most 64."""
    floor_sky_directions: int = FLOOR_SKY_DIRECTIONS
    """Directions in which the cloud hides the sky from the floor, at most 128."""
    use_disc_shadows: bool = True
    """Whether the shadows of sparse points are those of their discs."""
    use_normal_gnn: bool = True
    """Whether the network of `z2p_core.surface.normals` refines the normals."""


@dataclass(frozen=True)
class LightScene:
    """What light falls on: the points of a cloud and the floor, under a square area light and a uniform sky."""

    points: np.ndarray
    """(N, 3) float32, world units."""
    normals: np.ndarray
    """(N, 3) float32 unit normals that face the viewer."""
    spacing: float
    """Distance between neighboring points that shadows take the cloud to have, in world units."""
    radius: float
    """Radius around the origin within which the cloud lies, with a margin of one spacing."""
    light: tuple[float, float, float]
    """The area light's radius, azimuth and elevation (`z2p_core.camera.light_position`)."""
    floor: native.Floor

    @property
    def irradiance_cells(self) -> int:
        """Cells along a side of the floor for the light that it receives from the cloud."""
        fewest, most = IRRADIANCE_CELLS
        cells = 2 * FLOOR_HALF_WIDTH / (IRRADIANCE_CELL_SPACINGS * self.spacing)
        return round(min(max(cells, fewest), most))

    @classmethod
    def create(
        cls, points: np.ndarray, normals: np.ndarray, spacing: float, scene: SceneDescription, floor_height: float
    ) -> LightScene:  # fmt: skip
        """The points under the scene's light, above a floor at that height."""
        quad = area_light_quad(scene.light)
        light_axis = area_light_samples(scene.light, POINT_LIGHT_SAMPLES)[1][0]
        floor = native.Floor(
            floor_height, FLOOR_HALF_WIDTH, quad[0] + GAUSS_POINTS @ quad[1:], light_axis,
            LIGHT_RADIANCE * LIGHT_SIDE**2, AMBIENT, FLOOR_ALBEDO,
        )  # fmt: skip
        radius = math.sqrt(row_dots(points, points).max()) + spacing
        return cls(points, normals, spacing, radius, scene.light, floor)


@dataclass(frozen=True)
class PendingVisibility:
    """Visibility that a second core is computing."""

    _visible: np.ndarray
    _finish: Callable[[], None]

    def result(self) -> np.ndarray:
        """The complete array; this core takes part in what is left of the work."""
        self._finish()
        return self._visible


@dataclass(frozen=True)
class BouncedLight:
    """Radiance of white diffuse points and of a white floor after 0, 1, ... `BOUNCES` bounces within the cloud."""

    points: list[np.ndarray]
    """(2, N) each. The first holds direct light, the sky's and what the lit floor sends back."""
    floor: list[np.ndarray]
    """(G, G) each: what the floor's cells receive from the cloud in the first, second ... bounce."""

    def radiance(
        self, albedo: np.ndarray, sides: np.ndarray | int = 0, rows: np.ndarray | slice = slice(None)
    ) -> np.ndarray:  # fmt: skip
        """Radiance (M, A) of white points amid surfaces with the albedos (A,), on these sides of the points `rows`.

        A bounce counts by the albedo's power. The last one stands for all later ones as well, whose ratio to each
        other is assumed to be that of the last to the one before.
        """
        weights = albedo ** np.arange(BOUNCES + 1, dtype=np.float32)[:, None]
        weights[-1] /= 1 - self.last_ratio * albedo
        return np.einsum("bm,ba->ma", np.stack([bounce[sides, rows] for bounce in self.points]), weights)

    @cached_property
    def last_ratio(self) -> float:
        """Ratio of the last bounce to the one before it, which stands for those of all later bounces."""
        before, last = (float(bounce[0].mean()) for bounce in self.points[-2:])
        return min(last / max(before, 1e-6), MAX_BOUNCE_RATIO)


@dataclass(frozen=True)
class LightField:
    """All light on a scene, as shading reads it."""

    scene: LightScene
    direct: np.ndarray
    """Radiance (2, N) of white diffuse points under the area light alone."""
    occlusion: FloorOcclusion
    bounced: BouncedLight


def begin_point_visibility(scene: LightScene, quality: Quality) -> PendingVisibility:
    """Has a second core find the point (2 A, N) int32 that each point sees first along A axes and against them.

    See `z2p_core.native.first_visible`.
    """
    axes = hemisphere_axes(quality.sky_axes)
    points, normals, spacing, radius = scene.points, scene.normals, scene.spacing, scene.radius
    visible = np.empty((2 * len(axes), len(points)), np.int32)

    def look_around(begin: int, end: int) -> None:
        visible[2 * begin : 2 * end] = native.first_visible(points, normals, axes[begin:end], spacing, radius)

    return PendingVisibility(visible, begin_parallel_rows(look_around, len(axes), parts=8))


def begin_floor_visibility(scene: LightScene, quality: Quality) -> PendingVisibility:
    """Has a second core find the points that the floor's cells see: (A, 2, M) int32 for A directions.

    These are the M points of `sending_to_floor`; see `z2p_core.native.floor_visibility`.
    """
    stride, floor = floor_light_stride(len(scene.points)), scene.floor
    directions = cosine_hemisphere(2 * stride * quality.floor_directions)[::2]
    points, normals = (np.ascontiguousarray(rows[::stride]) for rows in (scene.points, scene.normals))
    visible, cells = np.empty((len(directions), 2, len(points)), np.int32), scene.irradiance_cells

    def look_up(begin: int, end: int) -> None:
        visible[begin:end] = native.floor_visibility(points, normals, directions[begin:end], floor, cells)

    return PendingVisibility(visible, begin_parallel_rows(look_up, len(directions), parts=4))


def floor_light_stride(count: int) -> int:
    """n, where every n-th of `count` points sends light to the floor."""
    return -(-count // MAX_FLOOR_LIGHT_POINTS)


def sending_to_floor(sides: np.ndarray) -> np.ndarray:
    """Values (2, M, ...) of those points that send light to the floor, of values (2, N, ...) of all."""
    return sides[:, :: floor_light_stride(sides.shape[1])]


def direct_radiance(scene: LightScene, casters: native.ShadowCasters) -> np.ndarray:
    """Radiance (2, N) of white diffuse points under the area light, where the casters do not hide it."""
    samples = area_light_samples(scene.light, POINT_LIGHT_SAMPLES)
    irradiance = native.direct_lighting(
        scene.points, scene.normals, casters, *samples, scene.spacing, scene.radius
    )  # fmt: skip
    return irradiance / math.pi


def bounce_light(
    scene: LightScene, direct: np.ndarray, occlusion: FloorOcclusion, point_visibility: np.ndarray,
    floor_visibility: np.ndarray, quality: Quality,
) -> BouncedLight:  # fmt: skip
    """Light from the sky and the lit floor to the points, and on from there to each other and to the floor."""
    cloud = (scene.points, scene.normals, hemisphere_axes(quality.sky_axes), point_visibility)
    points = [native.gather_environment(*cloud, direct, scene.floor, *occlusion)]
    floor, cells = [], scene.irradiance_cells
    for _ in range(BOUNCES):
        floor.append(native.floor_irradiance(sending_to_floor(points[-1]), floor_visibility, cells))
        points.append(native.gather_indirect(*cloud, points[-1], scene.floor, floor[-1]))
    return BouncedLight(points, floor)


def base_color(scene: SceneDescription) -> np.ndarray:
    """Linear color (3,) float32 of the surface; Blender's default where no control sets one."""
    color = scene.material.get("Base Color", DEFAULT_BASE_COLOR)
    return np.array(color[:3] if isinstance(color, tuple) else (color,) * 3, dtype=np.float32)
