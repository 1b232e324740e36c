"""Light on a cloud's points and on the floor below it: the lamp's, the sky's, and what these send to each other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.images import srgb_from_linear
from z2p_core.linalg import row_dots
from z2p_core.parallel import begin_parallel_rows
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription
from z2p_core.shading.area_light import cosine_hemisphere, area_light_samples, area_light_quad, hemisphere_axes
from z2p_core.shading.floor_shadow import FLOOR_HALF_WIDTH, FLOOR_SKY_DIRECTIONS, shadow_casters, floor_occlusion, is_sparse, eroded_share
from z2p_core.shading.microfacet import specular_directions
from z2p_core.surface.normals import Tangents

POINT_LIGHT_SAMPLES = 16
"""Points that stand for the area light over the cloud's points, a square number."""
GAUSS_POINTS = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) / math.sqrt(12)
"""Places on a square, in its sides from its middle, whose mean is that over all of it for light that changes slowly
(Gauss's quadrature)."""
IRRADIANCE_CELLS = 128
"""Cells of the floor a side for the light that comes back from the cloud."""
FLOOR_ALBEDO, FLOOR_ROUGHNESS, FLOOR_IOR = 0.8, 0.5, 1.5
"""Blender's own for a surface without a material, which is a Principled BSDF."""
BOUNCES, MAX_BOUNCE_RATIO, SECOND_FLOOR_BOUNCE_SHARE = 2, 0.9, 0.5
"""How often light is followed from point to point and over the floor, what later bounces keep of it at most, and the
share of the second one that the floor has: with it shadows are as dark as in renders of 512 samples."""
GREY_ALBEDO = 0.5
"""Albedo of the grey picture, below white under the nearest light."""


@dataclass(frozen=True)
class Quality:
    """How finely light is reckoned: what takes most of a G-buffer's time, and does not depend on a picture's size."""

    sky: int = 24
    """Axes whose two directions each stand for what a point sees around it."""
    below: int = 32
    """Directions in which the floor sees the cloud."""
    mirrored: int = 64
    """Directions in which the floor mirrors it, at most 64."""
    floor_sky: int = FLOOR_SKY_DIRECTIONS
    """Directions in which the cloud hides the sky from the floor, at most 128."""
    discs: bool = True
    """Whether discs cast the shadows of points that lie far apart, or these points alone."""
    agreed: bool = True
    """Whether neighbours agree upon their patches (`z2p_core.surface.normals`)."""


class Lighting:
    """Light on the points (N, 3) of a cloud of that spacing, whose normals (N, 3) face the viewer, and on its floor.

    The floor lies at that height. A second core looks around from the points, and from the floor, from the beginning;
    `follow` helps it and goes on.
    """

    def __init__(
        self, points: np.ndarray, normals: np.ndarray, spacing: float, scene: SceneDescription, height: float,
        detail: Quality,
    ) -> None:  # fmt: skip
        self.points, self.normals, self.spacing, self.light_at = points, normals, spacing, scene.light
        self.detail = detail
        self.color = np.array(base_color(scene), dtype=np.float32)
        self.radius = radius = math.sqrt(row_dots(points, points).max()) + spacing
        square = area_light_quad(scene.light)
        lamps = area_light_samples(scene.light, POINT_LIGHT_SAMPLES)
        quarters = square[0] + GAUSS_POINTS @ square[1:]
        self.floor = native.Floor(
            height, FLOOR_HALF_WIDTH, quarters, lamps[1][0], LIGHT_RADIANCE * LIGHT_SIDE**2, AMBIENT, FLOOR_ALBEDO
        )
        axes = hemisphere_axes(detail.sky)
        self.seen = seen = np.empty((2 * len(axes), len(points)), np.int32)

        def look_around(begin: int, end: int) -> None:
            """What the points see of each other along some axes and against them.

            It holds no `self`, which holds it: in a ring, a picture's arrays would stay until Python looks for such.
            """
            seen[2 * begin : 2 * end] = native.first_visible(points, normals, axes[begin:end], spacing, radius)

        self.look_around = begin_parallel_rows(look_around, len(axes), parts=8)
        from_below, floor = cosine_hemisphere(2 * detail.below)[::2], self.floor
        self.below = below = np.empty((len(from_below), 2, len(points)), np.int32)

        def look_up(begin: int, end: int) -> None:
            """What the floor sees of the points along some directions, in the meantime as well."""
            below[begin:end] = native.floor_hits(points, normals, from_below[begin:end], floor, IRRADIANCE_CELLS)

        self.look_up = begin_parallel_rows(look_up, len(from_below), parts=4)

    def shade(self, found: Tangents, radii: np.ndarray, sets: int) -> None:
        """Casts the shadows of discs with those radii (M,) on the points and the floor.

        So many `sets` (1, 2 or 4) of lamps stand for the light over the floor.
        """
        lamps = area_light_samples(self.light_at, POINT_LIGHT_SAMPLES)
        apart = self.detail.discs and is_sparse(self.spacing)
        casters = shadow_casters(self.points, self.spacing, found, radii, apart)
        lit = native.direct_lighting(self.points, self.normals, casters, *lamps, self.spacing, self.radius)
        self.direct = lit / math.pi
        self.shades = floor_occlusion(
            self.points, self.spacing, casters, self.light_at, self.floor.height, sets, apart, self.detail.floor_sky
        )

    def follow(self) -> None:
        """Follows the light from the sky and the lit floor to the points, and on from there."""
        cloud = (self.points, self.normals, hemisphere_axes(self.detail.sky))
        self.look_around()
        self.look_up()
        self.bounces = [native.gather_open(*cloud, self.seen, self.direct, self.floor, *self.shades)]
        self.glows = []
        for _ in range(BOUNCES):
            light = self.bounces[-1]
            self.glows.append(native.floor_glow(light, self.below, IRRADIANCE_CELLS))
            self.bounces.append(native.gather_bounced(*cloud, self.seen, light, self.floor, self.glows[-1]))

    def draw_shadow(self, camera: Camera, out: np.ndarray) -> None:
        """Draws into `out` (H, W) the alpha of the floor's shadow."""
        height, side = self.floor.height, len(self.shades[0]) // 2
        eyes = mirrored_viewpoints(camera.position, height, self.detail.mirrored)
        narrowed = eroded_share(self.spacing, side)
        mirrored = native.floor_shade(self.points, eyes, height, FLOOR_HALF_WIDTH, side, narrowed)
        native.floor_shadow(*self.shades, mirrored, self.radiance(), self.floor, camera, out)

    def radiance(self) -> np.ndarray:
        """Mean radiance (G, G) of the cloud as the floor's cells see it, over the three colours as well."""
        first, second = self.glows
        glow = self.color.mean() * first + SECOND_FLOOR_BOUNCE_SHARE * (self.color**2).mean() * second
        white = np.ones((2, len(self.normals)), np.float32)
        covered = native.floor_glow(white, self.below, IRRADIANCE_CELLS)
        mean: np.ndarray = _sum_3x3(glow) / np.maximum(_sum_3x3(covered), 1e-6)
        return mean

    def colors(self, viewer: np.ndarray) -> np.ndarray:
        """Radiance (N, 4) that the points send to the viewer (3,), sRGB: grey, then in the surface's colour."""
        albedo = np.array([GREY_ALBEDO, *self.color], dtype=np.float32)
        return srgb_from_linear(np.clip(albedo * self.light(albedo), 0, 1))

    def further(self) -> list[np.ndarray]:
        """Five more numbers (N, 5) of each point, if `finish` needs what discs show of them in a pixel."""
        return []

    def finish(self, camera: Camera, rows: tuple[int, int], pictures: list[np.ndarray]) -> None:
        """Finishes rows, from the first up to the last, that one excluded, of the first picture (9, H, W).

        For numbers of `further` there is a second one, with the normal towards the camera and them for features.
        """

    def light(self, albedo: np.ndarray) -> np.ndarray:
        """What diffuse surfaces of these albedos (A,) get: (N, A), as the radiance of a white one, linear."""
        return self.gathered([bounce[0] for bounce in self.bounces], albedo)

    def gathered(self, bounces: list[np.ndarray], albedo: np.ndarray) -> np.ndarray:
        """Light (M, A) on surfaces of these albedos (A,), which get so much of each bounce, (M,) each.

        The last has all later ones in it, each as much fainter than the one before as the last was.
        """
        before, last = (float(bounce[0].mean()) for bounce in self.bounces[-2:])
        shares = albedo ** np.arange(BOUNCES + 1, dtype=np.float32)[:, None]
        shares[-1] /= 1 - min(last / max(before, 1e-6), MAX_BOUNCE_RATIO) * albedo
        return np.einsum("bm,ba->ma", np.stack(bounces), shares)


def mirrored_viewpoints(viewer: np.ndarray, floor: float, count: int) -> np.ndarray:
    """Places (count, 3) below a rough floor of that height, from which a viewer (3,) would see what he sees mirrored.

    The lobe that the floor reflects to him is taken to have the same shape all over, that at its middle.
    """
    towards = viewer - (0.0, 0.0, floor)
    distance = float(np.linalg.norm(towards))
    aside = np.array([towards[0], towards[1], 0.0]) / max(math.hypot(towards[0], towards[1]), 1e-9)
    axes = np.stack([aside, np.cross((0.0, 0.0, 1.0), aside), (0.0, 0.0, 1.0)])
    ways = specular_directions(round(float(towards[2]) / distance, 4), FLOOR_ROUGHNESS, FLOOR_IOR, count)
    places: np.ndarray = np.array([0.0, 0.0, floor]) - distance * ways @ axes
    return places


def _sum_3x3(cells: np.ndarray) -> np.ndarray:
    """Sums over three by three cells; those beyond the border count as none."""
    padded = np.pad(cells, 1)
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    total: np.ndarray = rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
    return total


def base_color(scene: SceneDescription) -> tuple[float, float, float]:
    """Linear colour of the surface; Blender's own grey where no control sets one."""
    color = scene.material.get("Base Color", (0.8, 0.8, 0.8, 1.0))
    return (color[0], color[1], color[2]) if isinstance(color, tuple) else (color, color, color)
