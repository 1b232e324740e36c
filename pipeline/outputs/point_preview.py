"""A cloud as most viewers show it: a dot a point."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import DISTANCE, Camera


def draw_dots(cloud: np.ndarray, camera: Camera) -> np.ndarray:
    """Picture (H, W, 3) float64 of a placed cloud (N, 3) with a one-pixel dot a point, near ones darker."""
    picture = np.ones((camera.height, camera.width, 3))
    pixels, depth = camera.project(cloud.astype(np.float64))
    order = np.argsort(-depth, kind="stable")  # near dots last, over far ones
    column, row = np.floor(pixels[order]).astype(int).T
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height) & (depth[order] > 0)
    shade = np.clip(0.1 + 0.35 * (depth[order] - (DISTANCE - 1)), 0.0, 0.8)
    picture[row[inside], column[inside]] = shade[inside, None]
    return picture
