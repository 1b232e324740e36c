"""Depth of the nearest point in every pixel and in every window: the parts of z-buffers (paper section 3.1)."""

from __future__ import annotations

from functools import partial

import numpy as np

from z2p_core import native
from z2p_core.camera import DEPTH_RANGE, DISTANCE, Camera
from z2p_core.parallel import core_count, run_in_threads
from z2p_core.placement.placed_camera import PlacedCamera

INTENSITY_ALPHA = DEPTH_RANGE[0]
"""alpha of Eq. 1: the depth of intensity 1, that of the nearest point of the unit sphere, in world units."""
INTENSITY_BETA = 0.6
"""beta of Eq. 1: the distance over which intensity falls to 1/e, in world units."""
SPLAT_WINDOW = 5
"""Side in pixels of the square that a point covers (section 3.1)."""
MIN_POINTS_PER_THREAD = 200_000
"""Points below which a further thread costs more than it saves."""
MAX_THREADS = 8
"""Reading the points from memory is the bottleneck: more threads are not faster."""


def nearest_depth(cloud: np.ndarray, camera: Camera, margin: int = 0) -> np.ndarray:
    """Depth (H + 2 margin, W + 2 margin) float32 of the nearest point in each pixel, infinity where there is none.

    Each point of the cloud (N, 3) float32, in world units, falls into the one pixel that contains its projection. The
    margin, in pixels on every side, keeps points outside the image whose window reaches into it. Points behind the
    camera are dropped. Depths are counted so that the origin lies at `DISTANCE`, which they do by themselves before the
    usual camera.
    """
    if isinstance(camera, PlacedCamera):
        return _projected_depth(cloud, camera, margin)
    threads = min(MAX_THREADS, core_count(), len(cloud) // MIN_POINTS_PER_THREAD)
    if threads < 2:
        return native.nearest_depth(cloud, camera, margin)
    parts = np.array_split(cloud, threads)
    depths = run_in_threads([partial(native.nearest_depth, part, camera, margin) for part in parts])
    nearest = depths[0]
    for other in depths[1:]:
        np.minimum(nearest, other, out=nearest)
    return nearest


def _projected_depth(cloud: np.ndarray, camera: PlacedCamera, margin: int) -> np.ndarray:
    """`nearest_depth` for any camera."""
    height, width = camera.height + 2 * margin, camera.width + 2 * margin
    nearest = np.full((height, width), np.inf, np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):  # points in the camera's plane
        pixels, depth = camera.project(cloud)
        column, row = np.floor(pixels.T) + margin
    seen = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    seen &= camera.orthographic | (depth > 0)
    places = row[seen].astype(np.intp), column[seen].astype(np.intp)
    np.minimum.at(nearest, places, (depth[seen] + (DISTANCE - camera.origin_depth)).astype(np.float32))
    return nearest


def window_minimum(depths: np.ndarray, size: int) -> np.ndarray:
    """Minimum (H - size + 1, W - size + 1) of every size x size window of depths (H, W) float32.

    Also exact for the largest intensity in each window, because Eq. 1 decreases with depth.
    """
    return native.window_minimum(depths, size)
