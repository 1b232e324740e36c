"""Depth of the nearest point in every pixel and in every window: the parts of z-buffers (paper section 3.1)."""

from __future__ import annotations

from functools import partial

import numpy as np

from z2p_core import native
from z2p_core.camera import DEPTH_RANGE, DISTANCE, Camera
from z2p_core.camera_placement.placed_camera import PlacedCamera
from z2p_core.parallel import core_count, run_in_threads

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
    threads = max(min(MAX_THREADS, core_count(), len(cloud) // MIN_POINTS_PER_THREAD), 1)
    parts = np.array_split(cloud, threads)
    depths = run_in_threads([partial(native.nearest_depth, part, camera, margin) for part in parts])
    nearest = depths[0]
    for other in depths[1:]:
        np.minimum(nearest, other, out=nearest)
    if isinstance(camera, PlacedCamera):
        nearest += np.float32(DISTANCE - camera.origin_depth)
    return nearest


def window_minimum(depths: np.ndarray, size: int) -> np.ndarray:
    """Minimum (H - size + 1, W - size + 1) of every size x size window of depths (H, W) float32.

    Also exact for the largest intensity in each window, because Eq. 1 decreases with depth.
    """
    return native.window_minimum(depths, size)
