"""Patches of several colors: Voronoi cells (Worley, A Cellular Texture Basis Function, SIGGRAPH 1996)."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Texture
from z2p_renderer.plugins.textures._random import draw_palette, draw_period

COLORS = 5
MARGIN = 1.2
"""Half the side of the cube that is filled with cells: a little more than the unit sphere."""
BLOCK = 65_536
"""Positions whose distances to all cells are in memory at once."""


class Patches(Texture):
    """Each place has the color of the nearest of some random sites, one a cube of the period."""

    name = "patches"
    version = "1"
    period = (0.35, 0.7)

    def albedo(self, positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Linear colors (N, 3) float32 of a palette of `COLORS`."""
        palette, period = draw_palette(COLORS, rng), draw_period(self.period, rng)
        count = round((2 * MARGIN / period) ** 3)
        sites, colors = rng.uniform(-MARGIN, MARGIN, (count, 3)), rng.integers(COLORS, size=count)
        nearest = np.empty(len(positions), np.int64)
        for begin in range(0, len(positions), BLOCK):
            block = np.asarray(positions[begin : begin + BLOCK], np.float64)
            squared = np.zeros((len(block), count))
            for axis in range(3):
                squared += (block[:, axis, None] - sites[:, axis]) ** 2
            nearest[begin : begin + BLOCK] = squared.argmin(axis=1)
        return palette[colors[nearest]]
