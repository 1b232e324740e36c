"""A checkerboard in three dimensions."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Texture
from z2p_renderer.plugins.textures._random import draw_palette, draw_period, turned_positions


class Checks(Texture):
    """Cubes of two colors by turns."""

    name = "checks"
    version = "1"
    period = (0.2, 0.5)

    def albedo(self, positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Linear colors (N, 3) float32, two different ones; a period is a cube of each."""
        palette, period = draw_palette(2, rng), draw_period(self.period, rng)
        cubes = np.floor(2 * turned_positions(positions, rng) / period).astype(np.int64)
        return palette[cubes.sum(axis=1) % 2]
