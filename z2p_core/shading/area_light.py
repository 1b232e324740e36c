"""What stands for a scene's light: points for the square area light, and directions for the sky."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from z2p_core.camera import light_position
from z2p_core.scene import LIGHT_RADIANCE, LIGHT_SIDE

JITTER_OFFSETS = {1: [(0, 0)], 2: [(-0.25, -0.25), (0.25, 0.25)], 4: [(x, y) for x in (-0.25, 0.25) for y in (-0.25, 0.25)]}
"""Of that many sets of lamps, in the distance from lamp to lamp."""


@lru_cache(maxsize=8)
def area_light_quad(light: tuple[float, float, float]) -> np.ndarray:
    """The middle of the square area light, and its two sides: (3, 3)."""
    centre = light_position(light)
    axis = -centre / np.linalg.norm(centre)
    across = np.cross(axis, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    return np.stack([centre, LIGHT_SIDE * across, LIGHT_SIDE * np.cross(across, axis)])


@lru_cache(maxsize=8)
def area_light_samples(light: tuple[float, float, float], count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (L, 3), axes (L, 3) and powers (L,) of points spread over the square area light, L a square number.

    They are the middles of equal squares, row by row: with points less even, light on the whole is off by more than a
    shade shows.
    """
    centre, across, up = area_light_quad(light)
    axis = -centre / np.linalg.norm(centre)
    steps = (np.arange(math.isqrt(count)) + 0.5) / math.isqrt(count) - 0.5
    x, y = (place.reshape(-1, 1) for place in np.meshgrid(steps, steps))
    power = LIGHT_RADIANCE * LIGHT_SIDE**2 / count
    return centre + x * across + y * up, np.repeat(axis[None], count, axis=0), np.full(count, power)


@lru_cache(maxsize=8)
def jittered_sample_sets(light: tuple[float, float, float], count: int, sets: int) -> tuple[np.ndarray, ...]:
    """Places (count, 3) as those of `area_light_samples`, so many times (1, 2 or 4), each between those of the others."""
    lamps, square = area_light_samples(light, count)[0], area_light_quad(light)
    steps = np.array(JITTER_OFFSETS[sets]) / math.isqrt(count) @ square[1:]
    return tuple(lamps + step for step in steps)


@lru_cache(maxsize=4)
def hemisphere_axes(count: int) -> np.ndarray:
    """Directions (count, 3) spread evenly over the upper half of the sky."""
    return _fibonacci_spiral((np.arange(count) + 0.5) / count)


@lru_cache(maxsize=4)
def cosine_hemisphere(count: int) -> np.ndarray:
    """Directions (count, 3) of the sky, each of which gives a floor as much light."""
    return _fibonacci_spiral(np.sqrt((np.arange(count) + 0.5) / count))


def _fibonacci_spiral(height: np.ndarray) -> np.ndarray:
    """Unit directions (N, 3) of these heights (N,), each turned on by the golden angle."""
    angle = np.arange(len(height)) * math.pi * (3 - math.sqrt(5))
    side = np.sqrt(1 - height**2)
    return np.column_stack([side * np.cos(angle), side * np.sin(angle), height])
