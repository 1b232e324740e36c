"""Depth of the nearest point at every pixel, and of every window, in plain numpy: what the kernels are held against."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera


def nearest_depth(cloud: np.ndarray, camera: Camera, margin: int = 0) -> np.ndarray:
    """Depth (H + 2 margin, W + 2 margin) float32 of the nearest point in each pixel, infinity where there is none.

    Each point of the cloud (N, 3) float32, world units, falls into the one pixel that holds its projection. The margin
    keeps points outside the picture whose window may reach into it. Points behind the camera are dropped.
    """
    height, width = camera.height + 2 * margin, camera.width + 2 * margin
    depth_of_pixel = np.full(height * width, np.inf, dtype=np.float32)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # points in the camera's plane
        pixel, depth = camera.project(cloud)
        pixel = np.floor(pixel) + margin
        seen = (depth > 0) & (pixel >= 0).all(1) & (pixel[:, 0] < width) & (pixel[:, 1] < height)
    column, row = pixel[seen].astype(np.int64).T
    np.minimum.at(depth_of_pixel, row * width + column, depth[seen].astype(np.float32))
    return depth_of_pixel.reshape(height, width)


def window_minimum(picture: np.ndarray, size: int) -> np.ndarray:
    """Minimum (H - size + 1, W - size + 1) of every size x size window of (H, W).

    Exact for splats of intensity as well, because Eq. 1 falls with depth. Separable, and windows double along an axis.
    """
    for axis in (0, 1):
        span, shape = 1, picture.shape[axis] - size + 1
        while span * 2 <= size:
            picture = np.minimum(_cut(picture, axis, 0, -span), _cut(picture, axis, span, None))
            span *= 2
        if span < size:
            rest = size - span
            picture = np.minimum(_cut(picture, axis, 0, shape), _cut(picture, axis, rest, rest + shape))
    return picture


def _cut(picture: np.ndarray, axis: int, start: int, stop: int | None) -> np.ndarray:
    return picture[start:stop] if axis == 0 else picture[:, start:stop]
