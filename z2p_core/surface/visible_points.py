"""The points of a dense cloud that an image shows, at its resolution.

Of the points that share a small cell of the image, in front of everything else, the mean is taken: it is less noisy
than each of them, and the image could not show them apart. Points that surely lie behind the surface are left out.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from z2p_core import native
from z2p_core.camera import DISTANCE, Camera

CELLS_PER_PIXEL = 2.0
"""Cells along a side of a pixel, each of which shows one mean point at most."""
FRONT_CELL_SPACINGS = 2.5
"""Width of the coarse cells that tell what lies behind the surface, in spacings: few are empty by chance."""
MIN_FRONT_CELL_PIXELS = 2.0
"""The same in pixels, at least."""
FRONT_DEPTH_CELLS = 4.0
"""How far behind all coarse cells around it a point has to lie to be hidden, in widths of such a cell."""
MERGE_DEPTH_CELLS = 3.0
"""How far behind the nearest point of its cell a point may lie to count in the mean, in widths of a cell ..."""
MERGE_DEPTH_SIGMAS = 3.0
"""... plus this many standard deviations of the noise."""


def visible_points(
    cloud: np.ndarray, values: np.ndarray | None, camera: Camera, spacing: float, noise: float
) -> native.MergedPoints:  # fmt: skip
    """Mean points (M, 3) of the cells of an image that show points of a cloud (N, 3), in no particular order.

    Args:
        cloud: in world units.
        values: (N, 3) that are averaged as well; None for none.
        camera: the image's.
        spacing: distance between neighboring points, in world units.
        noise: standard deviation of the points off their surface, in world units.
    """
    pixel = DISTANCE / camera.focal
    merge_depth = MERGE_DEPTH_CELLS * pixel / CELLS_PER_PIXEL + MERGE_DEPTH_SIGMAS * noise
    return native.merge_visible(cloud, values, camera, CELLS_PER_PIXEL, merge_depth, _front(cloud, camera, spacing))


def _front(cloud: np.ndarray, camera: Camera, spacing: float) -> np.ndarray:
    """Depths (h, w) over the image behind which nothing shows: infinite where a coarse cell nearby holds no point."""
    pixel = DISTANCE / camera.focal
    pixels = max(FRONT_CELL_SPACINGS * spacing / pixel, MIN_FRONT_CELL_PIXELS)
    width, height = (max(math.ceil(side / pixels), 1) for side in (camera.width, camera.height))
    coarse = replace(camera, width=width, height=height)
    nearest = native.nearest_depth(cloud, coarse, margin=1)
    deepest = -native.window_minimum(np.negative(nearest), 3)
    return deepest + np.float32(FRONT_DEPTH_CELLS * pixels * pixel)
