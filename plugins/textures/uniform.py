"""One color everywhere: what textures are compared with."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Texture
from z2p_renderer.plugins.textures._random import draw_palette


class Uniform(Texture):
    """A random color."""

    name = "uniform"
    version = "1"

    def albedo(self, positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Linear colors (N, 3) float32, all the same."""
        return draw_palette(1, rng).repeat(len(positions), axis=0)
