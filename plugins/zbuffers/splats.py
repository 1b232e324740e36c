"""A pyramid of splats: the paper's 5x5 pixels, single pixels, wide splats that fill holes, and linear depth."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import DEPTH_RANGE, Camera
from z2p_core.interfaces import ZBuffer
from z2p_core.native import depth_to_intensity
from z2p_core.splatting import INTENSITY_ALPHA, INTENSITY_BETA, SPLAT_WINDOW, nearest_depth, window_minimum

WIDE_WINDOW = 13
"""Side in pixels of the widest splat: sparse clouds are read from it, dense ones from single pixels."""


class SplatPyramid(ZBuffer):
    """Four channels: intensity (Eq. 1) with windows of 5, 1 and 13 pixels, then linear depth, 1 near to 0 far."""

    name = "splats"
    version = "1"
    channels = 4

    def draw(self, cloud: np.ndarray, camera: Camera) -> np.ndarray:
        zbuffer = np.empty((self.channels, camera.height, camera.width), dtype=np.float32)
        self.draw_into(zbuffer, cloud, camera)
        return zbuffer

    def draw_into(self, out: np.ndarray, cloud: np.ndarray, camera: Camera) -> None:
        margin, inner_margin = WIDE_WINDOW // 2, WIDE_WINDOW // 2 - SPLAT_WINDOW // 2
        single = nearest_depth(cloud, camera, margin)
        paper = window_minimum(single, SPLAT_WINDOW)
        wide = window_minimum(paper, WIDE_WINDOW - SPLAT_WINDOW + 1)  # a minimum over windows of windows
        paper = paper[inner_margin:-inner_margin, inner_margin:-inner_margin]
        single = single[margin:-margin, margin:-margin]
        for channel, depth in enumerate((paper, single, wide)):
            depth_to_intensity(depth, INTENSITY_ALPHA, INTENSITY_BETA, out[channel])
        np.subtract(DEPTH_RANGE[1], paper, out=out[3])
        out[3] *= 0.5  # one over the depth range, which is 2
        np.clip(out[3], 0.0, 1.0, out=out[3])
