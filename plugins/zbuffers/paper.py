"""The paper's z-buffer: each point covers 5x5 pixels, the nearest wins (section 3.1, Eq. 1)."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera
from z2p_core.interfaces import ZBuffer
from z2p_core.splatting import nearest_depth, window_minimum

ALPHA = 2.6
"""Depth of intensity 1: the nearest point of the unit sphere, 3.6 away from the camera."""
BETA = 0.6
WINDOW = 5


class PaperZBuffer(ZBuffer):
    """One channel of intensity exp(-(d - ALPHA) / BETA), 0 for background."""

    name = "paper"
    version = "1"
    channels = 1

    def draw(self, cloud: np.ndarray, camera: Camera) -> np.ndarray:
        depth = window_minimum(nearest_depth(cloud, camera, margin=WINDOW // 2), WINDOW)
        return np.exp((ALPHA - depth) / BETA, dtype=np.float32)[None]  # (1, H, W); exp(-inf) is the background's 0
