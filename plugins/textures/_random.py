"""Random periods, axes and palettes of textures.

A change here changes the colors of all textures: raise their versions.
"""

from __future__ import annotations

import numpy as np

from z2p_core.images import linear_from_srgb
from z2p_core.rotations import random_rotation

SRGB_RANGE = (0.08, 0.95)
"""Darkest and brightest value of a channel, sRGB: no paint is blacker than black cloth or whiter than paper."""
MIN_DISTANCE = 0.4
"""Least distance between two colors of a palette, Euclidean in sRGB, so that a pattern can be seen."""
CANDIDATES = 64
"""Colors drawn for each one of a palette; the first that is distant enough is taken, or else the most distant one."""


def draw_period(period: tuple[float, float], rng: np.random.Generator) -> float:
    """A period between the shortest and the longest one, log-uniform, in their unit."""
    return float(np.exp(rng.uniform(*np.log(period))))


def turned_positions(positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Positions (N, 3) float64 in axes that are turned at random and shifted by up to 1 world unit each."""
    rotation, shift = random_rotation(rng), rng.uniform(-1, 1, 3)
    turned: np.ndarray = np.stack([(positions * axis).sum(axis=1) for axis in rotation], axis=1) + shift
    return turned


def draw_palette(count: int, rng: np.random.Generator) -> np.ndarray:
    """Linear colors (count, 3) float32 of which each is distant from those before it."""
    chosen = rng.uniform(*SRGB_RANGE, (1, 3))
    for _ in range(count - 1):
        candidates = rng.uniform(*SRGB_RANGE, (CANDIDATES, 3))
        distance = np.linalg.norm(candidates[:, None] - chosen, axis=2).min(axis=1)
        distant = np.flatnonzero(distance >= MIN_DISTANCE)
        chosen = np.vstack([chosen, candidates[distant[0] if len(distant) else int(distance.argmax())]])
    return linear_from_srgb(chosen).astype(np.float32)
