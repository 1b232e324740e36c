"""The paper's z-buffer: each point covers 5x5 pixels, and the nearest point wins (section 3.1, Eq. 1)."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera
from z2p_core.interfaces import ZBuffer
from z2p_core.splatting import INTENSITY_ALPHA, INTENSITY_BETA, SPLAT_WINDOW, nearest_depth, window_minimum


class PaperZBuffer(ZBuffer):
    """One channel of intensity exp(-(depth - INTENSITY_ALPHA) / INTENSITY_BETA), 0 where no point is."""

    name = "paper"
    version = "1"
    channels = 1

    def draw(self, cloud: np.ndarray, camera: Camera) -> np.ndarray:
        depth = window_minimum(nearest_depth(cloud, camera, margin=SPLAT_WINDOW // 2), SPLAT_WINDOW)
        intensity = np.exp((INTENSITY_ALPHA - depth) / INTENSITY_BETA, dtype=np.float32)  # background: exp(-inf)
        return intensity[None]  # (1, H, W)
