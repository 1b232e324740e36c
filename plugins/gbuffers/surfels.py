"""A rough rendering of the bare cloud: surfels lit through shadow maps, and the shadow that they cast on the floor.

Each point becomes a small disc in the plane through its neighbours (after Zwicker et al., Surface Splatting, 2001).
Nothing is solved for: normals are only turned to the viewer. What the network would have to imagine from light's three
numbers alone, where shade and shadow fall, is here in its place; the network makes a clean picture of it.
"""

from __future__ import annotations

import math

import numpy as np

from z2p_core import native
from z2p_core.camera import Camera, light_position
from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import GBuffer
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription

MOST_POINTS = 40_000
"""Of larger clouds so many points, chosen by their coordinates, stand for all."""
RADIUS, SLACK = 1.45, 1.2
"""Of a disc in spacings, wide enough to leave hardly a hole between random points (exp(-pi r^2), 0.1 %), and how far
behind the nearest disc another still counts, in radii."""
SURE = 25.0
"""Of coverage: a pixel that discs only touch with their rim stays in doubt."""
NEAR, FAR = 2.6, 4.6
"""Depths of the unit sphere's near and far end."""
LAMPS_A_SIDE, SKY_DIRECTIONS = 4, 16
FLOOR_HALF, FLOOR_CELL, FLOOR_MOST = 4.5, 0.02, 450
"""Extent of the floor that shadows are kept for, its finest cell in world units, and its most cells a side."""
GREY = 0.5
"""Albedo of the grey picture: dark enough to stay below white under the nearest light."""
SKY = 50.0
"""Distance at which a lamp is a direction."""


class Surfels(GBuffer):
    """Nine channels.

    Coverage; depth, 1 near to 0 far; normal to the right and down (2); grey radiance under the light, then radiance in
    the surface's colour (3), sRGB; all of these 0 off the discs. Last the floor shadow's alpha.
    """

    name = "surfels"
    version = "1"
    channels = 9

    def draw(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        picture = np.zeros((self.channels, camera.height, camera.width), dtype=np.float32)
        self.draw_into(picture, cloud, camera, scene)
        return picture

    def draw_into(self, out: np.ndarray, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> None:
        if not len(cloud):
            return
        floor = float(cloud[:, 2].min()) if scene.floor is None else scene.floor
        points, spacing, normals = native.surface(thinned(cloud, MOST_POINTS), camera.position)
        typical = max(float(np.median(spacing)), 1e-3)
        radii = RADIUS * np.clip(spacing, 0.5 * typical, 2.5 * typical)
        light = radiance(points, normals, typical, scene)[:, None]
        shaded = srgb_from_linear(np.clip(light * np.array([GREY, *base_color(scene)], dtype=np.float32), 0, 1))
        rotation = camera.rotation.astype(np.float32)
        facing = normals @ rotation.T
        native.surfels(
            (points - camera.position.astype(np.float32)) @ rotation.T, facing, radii,
            np.column_stack([facing[:, :2], shaded]), camera, SLACK, SURE, NEAR, FAR, out[:-1],
        )  # fmt: skip
        floor_shadow(points, typical, camera, scene, floor, out[-1])


def thinned(cloud: np.ndarray, most: int) -> np.ndarray:
    """At most about `most` points of a cloud (N, 3) float32, chosen by their coordinates whatever their order."""
    if len(cloud) <= most:
        return cloud
    bits = np.ascontiguousarray(cloud, dtype=np.float32).view(np.uint32)
    mixed = bits[:, 0] * np.uint32(0x9E3779B1) ^ bits[:, 1] * np.uint32(0x85EBCA77) ^ bits[:, 2] * np.uint32(0xC2B2AE3D)
    mixed = (mixed ^ mixed >> np.uint32(15)) * np.uint32(0x2C1B3C6D)
    kept: np.ndarray = cloud[mixed < np.uint32(min(most / len(cloud), 1.0) * 0xFFFFFFFF)]
    return kept


def base_color(scene: SceneDescription) -> tuple[float, float, float]:
    """Linear colour of the surface; Blender's own grey where no control sets one."""
    color = scene.material.get("Base Color", (0.8, 0.8, 0.8, 1.0))
    return (color[0], color[1], color[2]) if isinstance(color, tuple) else (color, color, color)


def radiance(points: np.ndarray, normals: np.ndarray, spacing: float, scene: SceneDescription) -> np.ndarray:
    """Radiance (N,) float32 of a white diffuse surface at the points: area light and sky, as far as they see them."""
    radius = float(np.sqrt((points**2).sum(1).max())) + spacing
    lamps, axes, powers = light_lamps(scene.light)
    direct = native.illuminate(points, normals, lamps, axes, powers, spacing, radius)
    sky = sky_lamps()
    towards = -sky / SKY
    # the whole sphere of directions would give a quarter of the powers' sum to an open point
    share = np.full(len(sky), 2.0 / SKY_DIRECTIONS * SKY**2)
    above = native.illuminate(points, normals, sky, towards, share, spacing, radius)
    return direct / math.pi + AMBIENT * (above + 0.5 * (1 - normals[:, 2]))


def light_lamps(light: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (16, 3), axes (16, 3) and powers (16,) of points spread over the square area light."""
    centre = light_position(light)
    axis = -centre / np.linalg.norm(centre)
    across = np.cross(axis, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    steps = ((np.arange(LAMPS_A_SIDE) + 0.5) / LAMPS_A_SIDE - 0.5) * LIGHT_SIDE
    x, y = (grid.reshape(-1, 1) for grid in np.meshgrid(steps, steps))
    lamps = centre + x * across + y * np.cross(across, axis)
    power = LIGHT_RADIANCE * LIGHT_SIDE**2 / len(lamps)
    return lamps, np.repeat(axis[None], len(lamps), axis=0), np.full(len(lamps), power)


def sky_lamps() -> np.ndarray:
    """Directions (16, 3) spread evenly over the upper half of the sky, as lamps far away."""
    height = (np.arange(SKY_DIRECTIONS) + 0.5) / SKY_DIRECTIONS
    angle = np.arange(SKY_DIRECTIONS) * math.pi * (3 - math.sqrt(5))
    side = np.sqrt(1 - height**2)
    return SKY * np.column_stack([side * np.cos(angle), side * np.sin(angle), height])


def floor_shadow(
    points: np.ndarray, spacing: float, camera: Camera, scene: SceneDescription, floor: float, out: np.ndarray
) -> None:
    """Draws into `out` (H, W) the alpha of the floor's shadow: the share of its light that the cloud takes away."""
    side = min(FLOOR_MOST, int(2 * FLOOR_HALF / max(spacing / 1.5, FLOOR_CELL)))
    lamps, axis, powers = light_lamps(scene.light)
    share = np.full(len(lamps), 1 / len(lamps))
    hidden_light = native.floor_shade(points, lamps, share, floor, FLOOR_HALF, side)
    sky = sky_lamps()
    hidden_sky = native.floor_shade(points, sky, sky[:, 2] / sky[:, 2].sum(), floor, FLOOR_HALF, side)
    centre = light_position(scene.light)
    native.floor_shadow(
        hidden_light, hidden_sky, floor, FLOOR_HALF, centre, axis[0], float(powers.sum()), math.pi * AMBIENT, camera,
        out,
    )  # fmt: skip
