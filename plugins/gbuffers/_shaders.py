"""What a G-buffer's surface looks like under a given light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from z2p_core.camera import Camera
from z2p_core.images import srgb_from_linear
from z2p_core.shading.light_transport import LightField

GREY_ALBEDO = 0.5
"""Albedo of the grey radiance: it stays below white under the nearest light."""
MIN_RADIANCE = 1e-4
"""Added to radiances before they are divided by each other, so that the darkest places keep a ratio near 1."""


class Shader(Protocol):
    """What a G-buffer's surface looks like under a given light."""

    def surfel_values(self, viewer: np.ndarray) -> list[np.ndarray]:
        """Values of each point for the layers to be rasterized.

        The first layer's are radiances (N, 4) in sRGB towards the viewer (3,): grey, then in the surface's material.
        Each further layer has five values (N, 5).
        """

    def shade_pixels(self, camera: Camera, rows: tuple[int, int], layers: list[np.ndarray]) -> None:
        """Completes the radiance in rows [first, last) of the first layer (9, H, W), after all have been rasterized."""


class MaterialShader(Shader, Protocol):
    """A shader of a surface in the scene's base color, which knows what other colors would change."""

    def total_albedo(self, albedo: np.ndarray) -> np.ndarray:
        """Share (N, 3) of light that points with these base colors (N, 3) send on, reflections included."""

    def relative_radiance(self, viewer: np.ndarray, radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Radiance towards the viewer of points with other base colors, over that of the shader's own surface.

        It is linear in the base color: the offset (N, 3) and the slope (N, 3). `radiance` (N, 3) is that of white
        points amid the colored ones.
        """


@dataclass(frozen=True)
class DiffuseShader:
    """A diffuse surface of one color: its radiance is the same from everywhere."""

    light: LightField
    color: np.ndarray

    def surfel_values(self, viewer: np.ndarray) -> list[np.ndarray]:
        albedo = np.array([GREY_ALBEDO, *self.color], dtype=np.float32)
        return [srgb_from_linear(np.clip(albedo * self.light.bounced.radiance(albedo), 0, 1))]

    def shade_pixels(self, camera: Camera, rows: tuple[int, int], layers: list[np.ndarray]) -> None:
        """Nothing: what surfels show of it is all there is."""

    def total_albedo(self, albedo: np.ndarray) -> np.ndarray:
        return albedo

    def relative_radiance(self, viewer: np.ndarray, radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        neutral = np.asarray(self.color, np.float32)
        received = self.light.bounced.radiance(neutral)
        slope = (radiance + MIN_RADIANCE) / (np.maximum(neutral, MIN_RADIANCE) * (received + MIN_RADIANCE))
        return np.zeros_like(slope), slope
