"""The cloud's own colors as the surface shows them, without the studio's light."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera
from z2p_core.interfaces import ColoredCloud, Condition
from z2p_core.scene import SceneDescription

MAX_ALBEDO = 1.5
"""Larger values are cut off: on glossy surfaces a texture's relative radiance is no ratio of albedos."""


class Albedo(Condition):
    """Three channels: the square root of the linear albedo, red to blue, times the surface's coverage.

    It is the radiance relative to the neutral surface times the neutral color: one more rasterization would cost more
    than it tells. So light that is reflected from other colors is part of it.
    """

    name = "albedo"
    version = "1"
    channels = 3

    def draw_into(self, out: np.ndarray, colored: ColoredCloud, camera: Camera, scene: SceneDescription) -> None:
        np.multiply(colored.relative[:3], colored.neutral[:, None, None], out=out)
        np.clip(out, 0, MAX_ALBEDO, out=out)
        np.sqrt(out, out=out)
        out *= colored.relative[3]
