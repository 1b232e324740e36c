"""The rough rendering for surfaces that shine: the lamp, the sky and the lit floor as they are reflected.

A surface is Blender's Principled BSDF: a diffuse part, which metal has none of, and a reflection, blurred by roughness.
The cloud's own parts are reflected as well, and what they reflect in turn; where it is blurred, they fade.
"""

from __future__ import annotations

import math

import numpy as np

from plugins.gbuffers.surfels import GREY, Lighting, Surfels
from z2p_core import native
from z2p_core.images import srgb_from_linear
from z2p_core.lamps import light_lamps
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription
from z2p_core.turning import along, products

LAMPS, SHARPEST = 36, 150.0
"""Points that stand for the reflected light, and the sharpest lobe that they show without gaps."""
MATT = (0.25, 1.0)
"""Roughness from which on a reflection fades into that of a diffuse surface, and where it is that."""
MIRRORS = 1
"""Of the cloud's own parts that light is followed over, from the viewer on."""
REACH = 1.2
"""Radius in spacings of the discs that are mirrored: of random points they leave a hundredth of the surface open."""
HEAD_ON = 0.08
"""What a dielectric reflects straight back, for each unit of "Specular IOR Level"."""


class Glossy(Surfels):
    """The channels of `Surfels`; radiance in the surface's colour has the material's reflection in it."""

    name = "glossy"
    version = "8"
    refines = "surfels"

    def reconcile(self, picture: np.ndarray, features: np.ndarray, points: int) -> None:
        """Leaves the picture as it is: reflections of the discs are not as near to the truth as the network's."""


class Reflections(Lighting):
    """Light on a cloud's points, and what of it they reflect."""

    def __init__(
        self, points: np.ndarray, normals: np.ndarray, spacing: float, scene: SceneDescription, height: float, sets: int
    ) -> None:
        super().__init__(points, normals, spacing, scene, height, sets)
        self.lamps, axes, self.powers = (x.astype(np.float32) for x in light_lamps(scene.light, LAMPS))
        self.axis = axes[0]
        self.metallic = _number(scene, "Metallic", 0.0)
        self.roughness = _number(scene, "Roughness", 1.0)
        self.sizes = REACH * spacing, spacing, self.radius  # of discs that rays meet, of gaps between points, of all
        self.sharpness, self.matt = lobe_sharpness(self.roughness), matt_share(self.roughness)
        specular = HEAD_ON * _number(scene, "Specular IOR Level", 0.0)
        self.head_on = specular * (1 - self.metallic) + self.color * self.metallic  # (3,), of the reflection's colour

    def colors(self, viewer: np.ndarray) -> np.ndarray:
        """Radiance (N, 4) that the points send to the viewer (3,), sRGB: grey and diffuse, then as the surface is."""
        towards = viewer.astype(np.float32) - self.points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        everyone = np.arange(len(self.points))
        shining = self.sent(everyone, np.zeros_like(everyone), towards, MIRRORS)
        grey = GREY * self.light(np.array([GREY]))
        return srgb_from_linear(np.clip(np.column_stack([grey, shining]), 0, 1)).astype(np.float32)

    def sent(self, rows: np.ndarray, sides: np.ndarray, towards: np.ndarray, mirrors: int) -> np.ndarray:
        """Radiance (M, 3) that points of these rows (M,) send in directions (M, 3), which lie on these sides (M,).

        Side 0 is the one that normals point to, 1 the other. Light is followed back over so many mirrors.
        """
        points, normals = self.points[rows], self.normals[rows] * np.where(sides, -1, 1).astype(np.float32)[:, None]
        facing = np.maximum(products(normals, towards), 1e-3)
        mirrored = 2 * facing[:, None] * normals - towards
        around = np.repeat(self.surroundings_in(points, mirrored)[:, None], 3, axis=1)
        if mirrors and self.matt < 1:
            self.add_parts(around, rows, mirrored, mirrors - 1)
        seen = around + self.lamp_in(points, normals, mirrored, self.direct[sides, rows])[:, None]
        seen = seen * (1 - self.matt) + self.light_on(rows, sides, self.head_on) * self.matt
        diffuse = self.color * self.light_on(rows, sides, self.color) * (1 - self.metallic)
        radiance: np.ndarray = diffuse + seen * reflectance(self.head_on, facing, self.roughness)
        return radiance

    def add_parts(self, around: np.ndarray, rows: np.ndarray, rays: np.ndarray, mirrors: int) -> None:
        """Puts, where rays (M, 3) from points of these rows meet another part, what it sends into `around` (M, 3).

        One ray stands for a lobe, so the wider that is, the more of what was there stays.
        """
        met = native.mirror_hits(self.points, self.normals, rows, rays, *self.sizes)
        meeting = np.flatnonzero(met >= 0)
        others, back = met[meeting], -rays[meeting]
        sides = (products(self.normals[others], back) < 0).astype(np.intp)
        around[meeting] *= self.matt
        around[meeting] += (1 - self.matt) * self.sent(others, sides, back, mirrors)

    def light_on(self, rows: np.ndarray, sides: np.ndarray, albedo: np.ndarray) -> np.ndarray:
        """What diffuse points of these rows and sides (M,) get, of these albedos (A,): (M, A), as `light` gives it."""
        return self.gathered([bounce[sides, rows] for bounce in self.bounces], albedo)

    def lamp_in(self, points: np.ndarray, normals: np.ndarray, mirrored: np.ndarray, direct: np.ndarray) -> np.ndarray:
        """Radiance (M,) of the light in lobes about directions (M, 3), hidden as much as it is from matt points (M, 3).

        `direct` (M,) is what such get of it.
        """
        away = self.lamps - points[:, None]  # (M, L, 3)
        square = np.einsum("nla,nla->nl", away, away)
        away /= np.sqrt(square)[..., None]
        shining = np.maximum(-(away @ self.axis), 0) / square  # (M, L)
        above = np.maximum(np.einsum("nla,na->nl", away, normals), 0)
        full = (self.powers * above * shining).sum(1) / math.pi
        open_share = np.clip(direct / np.maximum(full, 1e-4), 0, 1)
        lobe = np.exp(np.float32(self.sharpness) * (np.einsum("nla,na->nl", away, mirrored) - 1))
        lobe *= self.sharpness / (2 * math.pi * (1 - math.exp(-2 * self.sharpness)))  # 1 over the sphere
        solid_angle = LIGHT_SIDE**2 / LAMPS * shining
        radiance: np.ndarray = LIGHT_RADIANCE * (lobe * solid_angle * (above > 0)).sum(1) * open_share
        return radiance

    def surroundings_in(self, points: np.ndarray, mirrored: np.ndarray) -> np.ndarray:
        """Radiance (M,) of sky and lit floor in lobes about directions (M, 3) from points (M, 3)."""
        upwards = 1 / (1 + np.exp(-1.7 * math.sqrt(self.sharpness) * mirrored[:, 2]))  # share above the horizon
        radiance: np.ndarray = AMBIENT * upwards + self.floor_towards(points, mirrored) * (1 - upwards)
        return radiance

    def floor_towards(self, points: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Radiance (M,) of the floor where rays (M, 3) from points meet it; far off for one that goes up."""
        floor, side = self.floor, len(self.shades[0])
        reach = (floor.height - points[:, 2]) / np.minimum(rays[:, 2], -1e-3)
        place = points + reach[:, None] * rays
        away = floor.lamps.mean(0) - place
        square = (away**2).sum(1)
        lit = floor.power * np.maximum(-along(away, floor.axis), 0) * away[:, 2] / (square * square * math.pi)
        column, row = ((place[:, axis] + floor.half) * side / (2 * floor.half) for axis in (0, 1))
        inside = (column >= 0) & (row >= 0) & (column < side) & (row < side)
        cell = (np.where(inside, row, 0).astype(np.intp), np.where(inside, column, 0).astype(np.intp))
        no_lamp, no_sky = (np.where(inside, shade[cell], 0) for shade in self.shades)
        radiance: np.ndarray = floor.albedo * (lit * (1 - no_lamp) + floor.sky * (1 - no_sky))
        return radiance


Glossy.lighting = Reflections


def lobe_sharpness(roughness: float) -> float:
    """Sharpness of the spherical Gaussian near a reflected lobe (Wang et al., All-Frequency Rendering, 2009)."""
    alpha = max(roughness * roughness, 1e-3)
    return min(0.5 + 0.5 / alpha**2, SHARPEST)


def matt_share(roughness: float) -> float:
    """How far a reflection is that of a diffuse surface, from 0 to 1."""
    share = min(max((roughness - MATT[0]) / (MATT[1] - MATT[0]), 0.0), 1.0)
    return share * share * (3 - 2 * share)


def reflectance(head_on: np.ndarray, facing: np.ndarray, roughness: float) -> np.ndarray:
    """Share (N, 3) of surrounding light that is reflected to a viewer, of `head_on` (3,) where he looks straight at it.

    `facing` (N,) are cosines between normals and viewer. Lazarov's fit (Karis, Physically Based Shading on Mobile,
    2014), and what rough surfaces send back at a second bounce (Turquin, Practical Multiple Scattering, 2019).
    """
    x, y, z, w = roughness * np.array([-1, -0.0275, -0.572, 0.022]) + np.array([1, 0.0425, 1.04, -0.04])
    steep = np.minimum(x * x, 2 ** (-9.28 * facing)) * x + y
    scale, rim = -1.04 * steep + z, 1.04 * steep + w
    once = head_on * scale[:, None] + rim[:, None] * np.clip(50 * head_on, 0, 1)
    share: np.ndarray = once * (1 + head_on * (1 / (scale + rim)[:, None] - 1))
    return share


def _number(scene: SceneDescription, name: str, default: float) -> float:
    value = scene.material.get(name, default)
    return float(value) if isinstance(value, int | float) else default
