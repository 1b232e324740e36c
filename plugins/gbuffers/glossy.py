"""The rough rendering for surfaces that shine: the lamp, the sky and the lit floor as they are reflected.

A surface is Blender's Principled BSDF: a diffuse part, which metal has none of, and a reflection, blurred by roughness.
The cloud's own parts are reflected as well, and what they reflect in turn; where it is blurred, they fade. Highlights,
which may be smaller than the points lie apart, are reckoned for each pixel, by the normal that its discs agree upon.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.camera import DEPTH_RANGE, Camera
from z2p_core.images import srgb_from_linear
from z2p_core.linalg import dot_axis, row_dots
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, SceneDescription
from z2p_core.shading.area_light import area_light_samples, area_light_quad
from z2p_core.shading.channels import RADIANCE_RGB, STEADY_RGB, GBufferChannel, MaterialChannel
from z2p_core.shading.light_transport import GREY_ALBEDO, Quality, Lighting
from z2p_core.shading.principled import IOR, Principled
from z2p_renderer.plugins.gbuffers.surfels import Surfels

LAMPS, SMOOTHEST = 36, 0.04
"""Points that stand for the reflected light, and the least GGX alpha whose lobe shows them without gaps: smoother
surfaces show the light's image."""
BLUR, UNSURE = 1.7, 0.02
"""How far an image is blurred, in alpha, so that half of the light stays as near as in the lobe; and the alpha, at
least, for normals are not surer."""
SHARPEST, HORIZON = 150.0, 2.4
"""Sharpness, at most, of the lobe that blurs the horizon; and how steeply it crosses it, in its width."""
LEANING = 0.6
"""Of the way that lobes lean to the normal by the formula: lobes on metal balls are met best so."""
MATT = (0.1, 1.0)
"""Roughness from which on what surrounds a thing is reflected as by a matt one, little by little, and in full."""
MIRRORS = 1
"""Of the cloud's own parts that light is followed over, from the viewer on."""
REACH = 1.2
"""Radius in spacings of the discs that are mirrored: of random points they leave a hundredth of the surface open."""
AGREED, TORN = 0.98, 0.9
"""Length of the mean normal in a pixel from which on its discs agree, and up to which they do not: at creases."""


class Glossy(Surfels):
    """The channels of `Surfels`; radiance in the surface's colour has the material's reflection in it."""

    name = "glossy"
    version = "12"
    refines = "surfels"


@dataclass(frozen=True)
class Sent:
    """What M points send to a viewer, but for what they mirror of the lamp, the sky and the floor."""

    steady: np.ndarray
    """Radiance (M, 3), which changes little over a disc."""
    lit: np.ndarray
    """How much of the lamp shines on each (M,), from 0 to 1."""
    clear: np.ndarray
    """How much of sky or floor is mirrored (M,): what no part hides, as far as it is not reflected as if matt."""


class Reflections(Lighting):
    """Light on a cloud's points, and what of it they reflect."""

    def __init__(
        self, points: np.ndarray, normals: np.ndarray, spacing: float, scene: SceneDescription, height: float,
        detail: Quality,
    ) -> None:  # fmt: skip
        super().__init__(points, normals, spacing, scene, height, detail)
        places, axes, powers = area_light_samples(scene.light, LAMPS)
        self.lamps, self.square = (places, axes[0], float(powers[0])), area_light_quad(scene.light)
        self.roughness = _number(scene, "Roughness", 1.0)
        metallic, specular = _number(scene, "Metallic", 0.0), _number(scene, "Specular IOR Level", 0.0)
        self.surface = Principled(self.color, metallic, specular, self.roughness)
        self.sizes = REACH * spacing, spacing, self.radius  # of discs that rays meet, of gaps between points, of all
        self.sharpness, self.matt = lobe_sharpness(self.roughness), matt_share(self.roughness)

    def colors(self, viewer: np.ndarray) -> np.ndarray:
        """Radiance (N, 4) that the points send to the viewer (3,), sRGB: grey and diffuse, then as the surface is."""
        everyone, towards = np.arange(len(self.points)), ways_to(viewer, self.points)
        self.sent, shining = self.send(everyone, np.zeros_like(everyone), towards, MIRRORS)
        grey = GREY_ALBEDO * self.light(np.array([GREY_ALBEDO]))
        return displayed(np.column_stack([grey, shining]))

    def further(self) -> list[np.ndarray]:
        return [np.column_stack([self.sent.steady, self.sent.lit, self.sent.clear])]

    def finish(self, camera: Camera, rows: tuple[int, int], pictures: list[np.ndarray]) -> None:
        """Reckons mirrored lamp, sky and floor for each pixel where the discs agree which way it faces."""
        drawn, more = (picture[:, slice(*rows)] for picture in pictures)
        shown = drawn[GBufferChannel.COVERAGE] > 0
        of_discs, more = drawn[:, shown], more[:, shown]
        right, down = of_discs[GBufferChannel.NORMAL_RIGHT], of_discs[GBufferChannel.NORMAL_DOWN]
        facing = np.stack([right, down, more[MaterialChannel.NORMAL_FORWARD]], axis=1)
        length = np.linalg.norm(facing, axis=1)
        normals = (facing / np.maximum(length, 1e-6)[:, None]) @ camera.rotation.astype(np.float32)
        points = _places(of_discs[GBufferChannel.DEPTH], shown, camera, rows[0])
        seen = (points, normals, ways_to(camera.position, points))
        sent = Sent(more[STEADY_RGB].T, more[MaterialChannel.LIGHT_VISIBILITY], more[MaterialChannel.MIRROR_VISIBILITY])
        radiance = sent.steady + self.mirrored(*seen, sent, self.shine(*seen))
        sure = np.clip((length - TORN) / (AGREED - TORN), 0, 1)
        drawn[RADIANCE_RGB, shown] += sure * (displayed(radiance).T - of_discs[RADIANCE_RGB])

    def send(self, rows: np.ndarray, sides: np.ndarray, towards: np.ndarray, mirrors: int) -> tuple[Sent, np.ndarray]:
        """What points of these rows (M,) send in directions (M, 3), which lie on these sides (M,); radiance (M, 3).

        Side 0 is the one that normals point to, 1 the other. Light is followed back over so many mirrors; in the last
        one the floor beneath the thing is not seen, for it would be the thing itself that hides it from the sky.
        """
        points, normals = self.points[rows], self.normals[rows] * np.where(sides, -1, 1).astype(np.float32)[:, None]
        facing = np.maximum(row_dots(normals, towards), 1e-3)
        rays = 2 * facing[:, None] * normals - towards
        direct = self.direct[sides, rows]
        clear = np.full(len(rows), 1 - self.matt, np.float32)
        if not mirrors:
            clear *= 1 - self.beneath(points, leaning(rays, normals, self.roughness))
        light = self.gathered([bounce[sides, rows] for bounce in self.bounces], self.surface.albedo)
        around = (light - direct[:, None]) * (1 - clear)[:, None]
        if mirrors and self.matt < 1:
            self.add_parts(around, clear, rows, rays, mirrors - 1)
        steady = light * self.surface.diffuse_albedo(facing) + around * self.surface.specular_albedo(facing)
        shine, unhidden = self.gloss(points, normals, towards)
        sent = Sent(steady, np.clip(direct / np.maximum(unhidden, 1e-4), 0, 1), clear)
        if self.smooth:
            shine = self.shine(points, normals, towards)
        return sent, steady + self.mirrored(points, normals, towards, sent, shine)

    def add_parts(
        self, around: np.ndarray, clear: np.ndarray, rows: np.ndarray, rays: np.ndarray, mirrors: int
    ) -> None:
        """Adds, where rays (M, 3) from points of these rows meet another part, what it sends to `around` (M, 3).

        One ray stands for a lobe, so the wider that is, the more of what was there, and `clear` (M,), stays.
        """
        met = native.raycast_discs(self.points, self.normals, rows, rays, *self.sizes)
        meeting = np.flatnonzero(met >= 0)
        others, back = met[meeting], -rays[meeting]
        sides = (row_dots(self.normals[others], back) < 0).astype(np.intp)
        around[meeting] *= self.matt
        around[meeting] += (1 - self.matt) * self.send(others, sides, back, mirrors)[1]
        clear[meeting] *= self.matt

    @property
    def smooth(self) -> bool:
        """Whether the lamp's own image is seen in it."""
        return self.roughness**2 < SMOOTHEST

    def gloss(self, points: np.ndarray, normals: np.ndarray, towards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What rough surfaces at points (M, 3) mirror of the lamp (M, 3), and matt ones have of it (M,)."""
        return native.gloss(points, normals, towards, *self.lamps, max(self.roughness**2, SMOOTHEST), IOR)

    def shine(self, points: np.ndarray, normals: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """What this surface at points (M, 3) mirrors of the lamp, as `native.gloss` says it (M, 3)."""
        if not self.smooth:
            return self.gloss(points, normals, towards)[0]
        blur = BLUR * max(self.roughness**2, UNSURE)
        return native.image(points, normals, towards, self.square, LIGHT_RADIANCE, blur, IOR)

    def mirrored(
        self, points: np.ndarray, normals: np.ndarray, towards: np.ndarray, sent: Sent, shine: np.ndarray
    ) -> np.ndarray:
        """Radiance (M, 3) of lamp, sky and floor in surfaces at points (M, 3), as seen from directions (M, 3)."""
        facing = np.maximum(row_dots(normals, towards), 1e-3)
        lobes = leaning(2 * facing[:, None] * normals - towards, normals, self.roughness)
        around = self.surroundings_in(points, lobes) * sent.clear
        lamp = self.surface.specular_radiance(sent.lit[:, None] * shine, facing)
        return lamp + around[:, None] * self.surface.specular_albedo(facing)

    def surroundings_in(self, points: np.ndarray, lobes: np.ndarray) -> np.ndarray:
        """Radiance (M,) of sky and lit floor in lobes about directions (M, 3) from points (M, 3)."""
        upwards, lower = self.halves(lobes)
        floor = self.floor
        place, no_lamp, no_sky = self.floor_met(points, lower)
        away = floor.lamps.mean(0) - place
        square = (away**2).sum(1)
        lit = floor.power * np.maximum(-dot_axis(away, floor.axis), 0) * away[:, 2] / (square * square * math.pi)
        lit_floor = floor.albedo * (lit * (1 - no_lamp) + floor.sky * (1 - no_sky))
        radiance: np.ndarray = AMBIENT * upwards + lit_floor * (1 - upwards)
        return radiance

    def beneath(self, points: np.ndarray, lobes: np.ndarray) -> np.ndarray:
        """Share (M,) of lobes about directions (M, 3) from points (M, 3) with floor that sees nothing of the sky."""
        upwards, lower = self.halves(lobes)
        share: np.ndarray = (1 - upwards) * self.floor_met(points, lower)[2]
        return share

    def halves(self, lobes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How much (M,) of lobes about directions (M, 3) is above the horizon, and directions (M, 3) of the rest."""
        width = 1 / math.sqrt(self.sharpness)
        lower = lobes.copy()
        lower[:, 2] = -width * np.logaddexp(0, -lobes[:, 2] / width)
        lower /= np.linalg.norm(lower, axis=1, keepdims=True)
        return 1 / (1 + np.exp(-HORIZON / width * lobes[:, 2])), lower

    def floor_met(self, points: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where rays (M, 3) down from points (M, 3) meet the floor (M, 3), and how much of lamp and sky it lacks."""
        floor, side = self.floor, len(self.shades[0])
        reach = (floor.height - points[:, 2]) / np.minimum(rays[:, 2], -1e-3)
        place = points + reach[:, None] * rays
        column, row = ((place[:, axis] + floor.half) * side / (2 * floor.half) for axis in (0, 1))
        inside = (column >= 0) & (row >= 0) & (column < side) & (row < side)
        cell = (np.where(inside, row, 0).astype(np.intp), np.where(inside, column, 0).astype(np.intp))
        no_lamp, no_sky = (np.where(inside, shade[cell], 0) for shade in self.shades)
        return place, no_lamp, no_sky


Glossy.lighting = Reflections


def ways_to(viewer: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Unit directions (M, 3) float32 from points (M, 3) to the viewer (3,)."""
    ways = viewer.astype(np.float32) - points
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return ways


def displayed(radiance: np.ndarray) -> np.ndarray:
    """Radiance of any shape in sRGB, float32."""
    return srgb_from_linear(np.clip(radiance, 0, 1)).astype(np.float32)


def leaning(mirrored: np.ndarray, normals: np.ndarray, roughness: float) -> np.ndarray:
    """Middles (M, 3) of lobes about mirrored directions (M, 3), which lean to unit normals (M, 3) on rough surfaces.

    After Lagarde and de Rousiers, Moving Frostbite to Physically Based Rendering, 2014; they lean further.
    """
    leant = LEANING * (1 - (1 - roughness) * (math.sqrt(1 - roughness) + roughness))
    middles = mirrored + np.float32(leant) * (normals - mirrored)
    middles /= np.maximum(np.linalg.norm(middles, axis=1, keepdims=True), 1e-6)
    return middles


def lobe_sharpness(roughness: float) -> float:
    """Sharpness of the spherical Gaussian near a reflected lobe (Wang et al., All-Frequency Rendering, 2009)."""
    alpha = max(roughness * roughness, 1e-3)
    return min(0.5 + 0.5 / alpha**2, SHARPEST)


def matt_share(roughness: float) -> float:
    """How far surroundings are reflected as by a diffuse surface, from 0 to 1."""
    share = min(max((roughness - MATT[0]) / (MATT[1] - MATT[0]), 0.0), 1.0)
    return share * share * (3 - 2 * share)


def _places(depth: np.ndarray, shown: np.ndarray, camera: Camera, top: int) -> np.ndarray:
    """World positions (M, 3) float32 of the pixels `shown` (h, W), in rows from `top` on, by the depths (M,) drawn."""
    row, column = np.nonzero(shown)
    near, far = DEPTH_RANGE
    away = far - (far - near) * depth
    x = (column + 0.5 - camera.width / 2) / camera.focal * away
    y = (row + top + 0.5 - camera.height / 2) / camera.focal * away
    places: np.ndarray = np.stack([x, y, away], axis=1) @ camera.rotation + camera.position
    return places.astype(np.float32)


def _number(scene: SceneDescription, name: str, default: float) -> float:
    value = scene.material.get(name, default)
    return float(value) if isinstance(value, int | float) else default
