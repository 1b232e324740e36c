"""Fine broken lines on paper, like lines of text seen from afar."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Texture
from z2p_renderer.plugins.textures._random import draw_palette, draw_period, turned_positions

LINE_SHARE = 0.35
"""Thickness of a line, in periods."""
WORDS = ((1.7, 0.0), (2.9, 0.4), (4.3, 0.8))
"""Waves along the lines whose sum breaks them into words: wavelength in periods, and phase from line to line, turns."""
GAP_LEVEL = -0.6
"""Sum of the waves below which there is a gap between words."""


class Lines(Texture):
    """Thin slabs, one a period, interrupted at irregular distances."""

    name = "lines"
    version = "1"
    period = (0.08, 0.16)

    def albedo(self, positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Linear colors (N, 3) float32, two different ones; a period is the distance of two lines."""
        palette, period = draw_palette(2, rng), draw_period(self.period, rng)
        along, across, _ = turned_positions(positions, rng).T / period
        line = np.floor(across)
        waves = [np.sin(2 * np.pi * (along / wavelength + turns * line)) for wavelength, turns in WORDS]
        written = (across - line < LINE_SHARE) & (np.sum(waves, axis=0) > GAP_LEVEL)
        return palette[written.astype(np.int64)]
