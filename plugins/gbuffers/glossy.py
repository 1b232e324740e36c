"""The rough rendering for surfaces that shine: the lamp, the sky and the lit floor as they are reflected.

A surface is Blender's Principled BSDF: a diffuse part, which metal has none of, and a reflection, blurred by roughness.
What the cloud's own parts look like in each other is left to the network.
"""

from __future__ import annotations

import math

import numpy as np

from plugins.gbuffers.surfels import GREY, Lighting, Surfels, light_lamps
from z2p_core.images import srgb_from_linear
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription
from z2p_core.turning import along

LAMPS, SHARPEST = 36, 150.0
"""Points that stand for the reflected light, and the sharpest lobe that they show without gaps."""
MATT = (0.25, 1.0)
"""Roughness from which on a reflection fades into that of a diffuse surface, and where it is that."""
HEAD_ON = 0.08
"""What a dielectric reflects straight back, for each unit of "Specular IOR Level"."""


class Glossy(Surfels):
    """The channels of `Surfels`; radiance in the surface's colour has the material's reflection in it."""

    name = "glossy"
    version = "6"
    refines = "surfels"


class Reflections(Lighting):
    """Light on a cloud's points, and what of it they reflect."""

    def __init__(
        self, points: np.ndarray, normals: np.ndarray, spacing: float, scene: SceneDescription, height: float,
        viewer: np.ndarray,
    ) -> None:  # fmt: skip
        super().__init__(points, normals, spacing, scene, height, viewer)
        self.lamps, axes, self.powers = (x.astype(np.float32) for x in light_lamps(scene.light, LAMPS))
        self.axis = axes[0]
        self.metallic = _number(scene, "Metallic", 0.0)
        self.roughness = _number(scene, "Roughness", 1.0)
        self.head_on = HEAD_ON * _number(scene, "Specular IOR Level", 0.0)

    def colors(self, viewer: np.ndarray) -> np.ndarray:
        """Radiance (N, 4) that the points send to the viewer (3,), sRGB: grey and diffuse, then as the surface is."""
        towards = viewer.astype(np.float32) - self.points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        facing = np.maximum((self.normals * towards).sum(1), 1e-3)
        mirrored = 2 * facing[:, None] * self.normals - towards
        head_on = self.head_on * (1 - self.metallic) + self.color * self.metallic  # (3,), of the reflection's colour
        sharpness = lobe_sharpness(self.roughness)
        seen = self.lamp_in(mirrored, sharpness) + self.surroundings_in(mirrored, sharpness)
        matt = np.clip((self.roughness - MATT[0]) / (MATT[1] - MATT[0]), 0, 1)
        matt = matt * matt * (3 - 2 * matt)
        seen = seen[:, None] * (1 - matt) + self.light(head_on) * matt
        diffuse = self.color * self.light(self.color) * (1 - self.metallic)
        shining = diffuse + seen * reflectance(head_on, facing, self.roughness)
        grey = GREY * self.light(np.array([GREY]))
        return srgb_from_linear(np.clip(np.column_stack([grey, shining]), 0, 1)).astype(np.float32)

    def lamp_in(self, mirrored: np.ndarray, sharpness: float) -> np.ndarray:
        """Radiance (N,) of the light in lobes about directions (N, 3), hidden as much as it is from a matt surface."""
        away = self.lamps - self.points[:, None]  # (N, L, 3)
        square = np.einsum("nla,nla->nl", away, away)
        away /= np.sqrt(square)[..., None]
        shining = np.maximum(-(away @ self.axis), 0) / square  # (N, L)
        above = np.maximum(np.einsum("nla,na->nl", away, self.normals), 0)
        full = (self.powers * above * shining).sum(1) / math.pi
        open_share = np.clip(self.direct[0] / np.maximum(full, 1e-4), 0, 1)
        lobe = np.exp(np.float32(sharpness) * (np.einsum("nla,na->nl", away, mirrored) - 1))
        lobe *= sharpness / (2 * math.pi * (1 - math.exp(-2 * sharpness)))  # 1 over the sphere
        solid_angle = LIGHT_SIDE**2 / LAMPS * shining
        radiance: np.ndarray = LIGHT_RADIANCE * (lobe * solid_angle * (above > 0)).sum(1) * open_share
        return radiance

    def surroundings_in(self, mirrored: np.ndarray, sharpness: float) -> np.ndarray:
        """Radiance (N,) of sky and lit floor in lobes about directions (N, 3)."""
        upwards = 1 / (1 + np.exp(-1.7 * math.sqrt(sharpness) * mirrored[:, 2]))  # share of a lobe above the horizon
        radiance: np.ndarray = AMBIENT * upwards + self.floor_towards(mirrored) * (1 - upwards)
        return radiance

    def floor_towards(self, rays: np.ndarray) -> np.ndarray:
        """Radiance (N,) of the floor where rays (N, 3) from the points meet it; far off for one that goes up."""
        floor, side = self.floor, len(self.shades[0])
        reach = (floor.height - self.points[:, 2]) / np.minimum(rays[:, 2], -1e-3)
        place = self.points + reach[:, None] * rays
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
