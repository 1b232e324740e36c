"""A pyramid of splats: the paper's 5x5, single pixels, a wide one that fills holes, and plain depth."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera
from z2p_core.interfaces import ZBuffer
from z2p_core.native import intensity
from z2p_core.splatting import nearest_depth, window_minimum

ALPHA, BETA = 2.6, 0.6
"""As in Eq. 1 of the paper."""
MIDDLE, WIDE = 5, 13
"""Window sides in pixels: dense clouds are read from single pixels, sparse ones from the wide splat."""
FAR = 4.6
"""Depth of the far end of the unit sphere; the sphere is 2 deep."""


class SplatPyramid(ZBuffer):
    """Four channels: intensity (Eq. 1) with windows of 5, 1 and 13 pixels, then linear depth, 1 near to 0 far."""

    name = "splats"
    version = "1"
    channels = 4

    def draw(self, cloud: np.ndarray, camera: Camera) -> np.ndarray:
        picture = np.empty((self.channels, camera.height, camera.width), dtype=np.float32)
        self.draw_into(picture, cloud, camera)
        return picture

    def draw_into(self, out: np.ndarray, cloud: np.ndarray, camera: Camera) -> None:
        margin, inner = WIDE // 2, WIDE // 2 - MIDDLE // 2
        single = nearest_depth(cloud, camera, margin)
        middle = window_minimum(single, MIDDLE)
        wide = window_minimum(middle, WIDE - MIDDLE + 1)  # a window of windows
        middle = middle[inner:-inner, inner:-inner]
        for channel, depth in enumerate((middle, single[margin:-margin, margin:-margin], wide)):
            intensity(depth, ALPHA, BETA, out[channel])
        np.subtract(FAR, middle, out=out[3])
        out[3] *= 0.5
        np.clip(out[3], 0.0, 1.0, out=out[3])
