"""A cloud as most viewers show it: one dot for each point."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import DISTANCE, Camera


def draw_dots(cloud: np.ndarray, camera: Camera) -> np.ndarray:
    """Picture (H, W, 3) float64 in [0, 1] of a placed cloud (N, 3), a pixel for each point; near ones are darker."""
    picture = np.ones((camera.height, camera.width, 3))
    pixels, depth = camera.project(cloud.astype(np.float64))
    far_to_near = np.argsort(-depth, kind="stable")  # near dots last, so that they cover far ones
    column, row = np.floor(pixels[far_to_near]).astype(int).T
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height) & (depth[far_to_near] > 0)
    gray = np.clip(0.1 + 0.35 * (depth[far_to_near] - (DISTANCE - 1)), 0.0, 0.8)
    picture[row[inside], column[inside]] = gray[inside, None]
    return picture
