"""Gradients of color over the whole object."""

from __future__ import annotations

import numpy as np

from z2p_core.images import linear_from_srgb
from z2p_core.interfaces import Texture
from z2p_core.rotations import random_rotation
from z2p_renderer.plugins.textures._random import draw_period

MEAN_SRGB = 0.5
AMPLITUDE_SRGB = 0.4


class Smooth(Texture):
    """A plane wave in each channel, the three of them at right angles to one another."""

    name = "smooth"
    version = "1"
    period = (0.9, 1.8)

    def albedo(self, positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Linear colors (N, 3) float32 that vary with a period of about the object's radius."""
        axes = random_rotation(rng)
        periods = [draw_period(self.period, rng) for _ in range(3)]
        phases = rng.uniform(0, 2 * np.pi, 3)
        srgb = np.empty((len(positions), 3))
        for channel, (axis, period, phase) in enumerate(zip(axes, periods, phases, strict=True)):
            wave = np.sin(2 * np.pi / period * (positions * axis).sum(axis=1) + phase)
            srgb[:, channel] = MEAN_SRGB + AMPLITUDE_SRGB * wave
        return linear_from_srgb(srgb).astype(np.float32)
