"""Samples of a scene's light: points on the square area light, and directions of the sky."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from z2p_core.camera import light_position
from z2p_core.scene import LIGHT_RADIANCE, LIGHT_SIDE

JITTER_OFFSETS = {
    1: [(0, 0)], 2: [(-0.25, -0.25), (0.25, 0.25)], 4: [(x, y) for x in (-0.25, 0.25) for y in (-0.25, 0.25)]
}  # fmt: skip
"""Offsets of 1, 2 or 4 sample sets against each other, in the distance between neighbouring samples."""


@lru_cache(maxsize=8)
def area_light_quad(light: tuple[float, float, float]) -> np.ndarray:
    """The square area light (3, 3): its center, and its two sides as vectors of length `LIGHT_SIDE`.

    `light` is its radius, azimuth and elevation, see `z2p_core.camera.light_position`. It faces the origin.
    """
    center = light_position(light)
    axis = -center / np.linalg.norm(center)
    across = np.cross(axis, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    return np.stack([center, LIGHT_SIDE * across, LIGHT_SIDE * np.cross(across, axis)])


@lru_cache(maxsize=8)
def area_light_samples(
    light: tuple[float, float, float], count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Positions (L, 3), unit axes (L, 3) and powers (L,) of `count` = L samples of the area light, L a square number.

    The samples are the centers of equal squares, row by row: a less even pattern would change the total light visibly.
    A sample of power p gives a point at distance d the irradiance p cos_light cos_surface / d^2.
    """
    center, across, up = area_light_quad(light)
    axis = -center / np.linalg.norm(center)
    steps = (np.arange(math.isqrt(count)) + 0.5) / math.isqrt(count) - 0.5
    x, y = (coordinates.reshape(-1, 1) for coordinates in np.meshgrid(steps, steps))
    power = LIGHT_RADIANCE * LIGHT_SIDE**2 / count
    return center + x * across + y * up, np.repeat(axis[None], count, axis=0), np.full(count, power)


@lru_cache(maxsize=8)
def jittered_sample_sets(light: tuple[float, float, float], count: int, sets: int) -> tuple[np.ndarray, ...]:
    """`sets` (1, 2 or 4) times the positions (count, 3) of `area_light_samples`, each set between those of the others.

    All sets together sample the light as finely as sets * count samples would, but each fits into 64 bits.
    """
    positions, quad = area_light_samples(light, count)[0], area_light_quad(light)
    offsets = np.array(JITTER_OFFSETS[sets]) / math.isqrt(count) @ quad[1:]
    return tuple(positions + offset for offset in offsets)


@lru_cache(maxsize=4)
def hemisphere_axes(count: int) -> np.ndarray:
    """Unit vectors (count, 3), uniformly distributed over the upper hemisphere."""
    return _fibonacci_spiral((np.arange(count) + 0.5) / count)


@lru_cache(maxsize=4)
def cosine_hemisphere(count: int) -> np.ndarray:
    """Unit vectors (count, 3) over the upper hemisphere, cosine-weighted: each gives a floor the same irradiance."""
    return _fibonacci_spiral(np.sqrt((np.arange(count) + 0.5) / count))


def _fibonacci_spiral(height: np.ndarray) -> np.ndarray:
    """Unit vectors (N, 3) with these Z coordinates (N,), each turned by the golden angle against the one before."""
    angle = np.arange(len(height)) * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - height**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
