"""Round spots on a ground of another color."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Texture
from z2p_renderer.plugins.textures._random import draw_palette, draw_period, turned_positions

RADIUS_IN_PERIODS = 0.35
"""Radius of a ball: a surface amid them is covered to a fifth."""


class Spots(Texture):
    """Balls on a cubic lattice; where the surface cuts one there is a spot."""

    name = "spots"
    version = "1"

    def albedo(self, positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Linear colors (N, 3) float32, two different ones; a period is the distance of two balls."""
        palette, period = draw_palette(2, rng), draw_period(self.period, rng)
        cells = turned_positions(positions, rng) / period
        offsets = cells - np.round(cells)
        return palette[((offsets**2).sum(axis=1) < RADIUS_IN_PERIODS**2).astype(np.int64)]
