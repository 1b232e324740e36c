"""Parallel stripes with sharp edges."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Texture
from z2p_renderer.plugins.textures._random import draw_palette, draw_period, turned_positions


class Stripes(Texture):
    """Slabs of two colors by turns, all of one thickness."""

    name = "stripes"
    version = "1"

    def albedo(self, positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Linear colors (N, 3) float32, two different ones; a period is a stripe of each."""
        palette, period = draw_palette(2, rng), draw_period(self.period, rng)
        across = turned_positions(positions, rng)[:, 0] / period
        return palette[np.floor(2 * across).astype(np.int64) % 2]
