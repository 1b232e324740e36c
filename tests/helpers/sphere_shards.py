"""Shards without Blender: unit spheres drawn ray by ray, shaded by Lambert's law, with their own points."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from z2p_core.camera import DISTANCE, Camera, light_position
from z2p_core.images import linear_from_srgb
from z2p_core.rotations import random_rotation
from z2p_core.scene import SceneDescription
from z2p_renderer.storage.shards import Record, write_shard

CONTROLS = [
    {"name": "color", "version": "1", "size": 3},
    {"name": "light", "version": "1", "size": 3},
    {"name": "elevation", "version": "1", "size": 1},
]


def sphere_record(side: int, rng: np.random.Generator, radius: float = 0.8) -> Record:
    """A sphere in a random colour under a random light, seen from a random elevation."""
    color, elevation = rng.uniform(0.1, 1.0, 3), float(rng.uniform(0, 80))
    light = (rng.uniform(3, 4.5), rng.uniform(-90, 90), rng.uniform(25, 75))
    camera = Camera(side, side, elevation)
    column, row = np.meshgrid(np.arange(side) + 0.5, np.arange(side) + 0.5)
    rays = np.stack([(column - side / 2) / camera.focal, (row - side / 2) / camera.focal, np.ones_like(row)], -1)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ camera.rotation
    along = rays @ camera.position
    inside = along**2 - DISTANCE**2 + radius**2
    hit = camera.position + rays * (-along - np.sqrt(np.maximum(inside, 0)))[..., None]
    direction = light_position(light) / np.linalg.norm(light_position(light))
    shade = 0.3 + 0.7 * np.maximum(hit / radius @ direction, 0)
    rgba = np.zeros((side, side, 4), np.uint8)
    rgba[inside > 0, :3] = (255 * color * shade[inside > 0, None] + 0.5).astype(np.uint8)
    rgba[..., 3] = np.where(inside > 0, 255, 0)
    low, high = np.array([0, 0, 0, 3, -90, 25, 0]), np.array([1, 1, 1, 4.5, 90, 75, 80])
    settings, mirrored = (
        ((np.array([*color, light[0], azimuth, light[2], elevation]) - low) / (high - low)).astype(np.float32)
        for azimuth in (light[1], -light[1])
    )
    rotation = tuple(tuple(row) for row in random_rotation(rng).tolist())
    material = {"Base Color": (*(float(linear_from_srgb(x)) for x in color), 1.0)}
    scene = SceneDescription(elevation, tuple(map(float, light)), material, rotation)
    return Record(rgba, rgba[..., 3].copy(), settings, mirrored, scene)


def sphere_shard(
    path: Path, count: int, side: int, seed: int = 0, points: int = 4000, metallic: bool = False
) -> Path:
    """A shard of `count` spheres; with `metallic`, that control is among their settings, though it changes nothing."""
    rng = np.random.default_rng(seed)
    pool = rng.normal(size=(points, 3))
    pool = (0.8 * pool / np.linalg.norm(pool, axis=1, keepdims=True)).astype(np.float32)
    records = [sphere_record(side, rng) for _ in range(count)]
    controls = list(CONTROLS)
    if metallic:
        controls.append({"name": "metallic", "version": "1", "size": 1})
        more = rng.random(count, dtype=np.float32)
        records = [
            replace(one, settings=np.append(one.settings, number), mirrored_settings=np.append(one.settings, number))
            for one, number in zip(records, more, strict=True)
        ]
    write_shard(path, records, pool, {"mesh": path.stem, "controls": controls, "resolution": side})
    return path
