"""Band-limited noise between two colors, as on stone or cloth."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Texture
from z2p_renderer.plugins.textures._random import draw_palette, draw_period

WAVES = 24
"""Plane waves that are summed up."""
BAND = 1.5
"""Longest and shortest wavelength are the period times and divided by this."""
CONTRAST = 0.7
"""Standard deviations of the noise from the middle between the two colors to either of them."""


class Noise(Texture):
    """A sum of plane waves in random directions, whose wavelengths are all near the period."""

    name = "noise"
    version = "1"

    def albedo(self, positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Linear colors (N, 3) float32 on the line between two different ones."""
        palette, period = draw_palette(2, rng), draw_period(self.period, rng)
        directions = rng.normal(size=(WAVES, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        wavelengths = period * BAND ** rng.uniform(-1, 1, WAVES)
        total = np.zeros(len(positions))
        for direction, wavelength, phase in zip(directions, wavelengths, rng.uniform(0, 1, WAVES), strict=True):
            total += np.sin(2 * np.pi * ((positions * direction).sum(axis=1) / wavelength + phase))
        deviation = np.sqrt(WAVES / 2)
        share = np.clip(0.5 + total / (2 * CONTRAST * deviation), 0, 1)[:, None].astype(np.float32)
        return palette[0] + share * (palette[1] - palette[0])
