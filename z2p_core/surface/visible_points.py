"""The points of a dense cloud that an image shows, at its resolution.

Of the points that share a small cell of the image, in front of everything else, the mean is taken: it is less noisy
than each of them, and the image could not show them apart. Points that surely lie behind the surface are left out.
"""

from __future__ import annotations

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
"""How far behind the nearest point of its cell a point may lie to count in the mean, in widths of the cell ..."""
MERGE_DEPTH_SIGMAS = 3.0
"""... plus this many standard deviations of the noise."""
SURVEY_CELL_PIXELS = 16.0
"""Width of the cells in which the depths of what a user's camera sees are surveyed."""


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
    pixel_spacing = spacing / camera.pixel_width(typical_depth(cloud, camera))
    front_pixels = max(FRONT_CELL_SPACINGS * pixel_spacing, MIN_FRONT_CELL_PIXELS)
    front = _front(cloud, camera, front_pixels)
    return native.merge_visible(
        cloud, values, camera, CELLS_PER_PIXEL, MERGE_DEPTH_CELLS, MERGE_DEPTH_SIGMAS * noise, front, front_pixels
    )


def typical_depth(cloud: np.ndarray, camera: Camera) -> float:
    """Median depth over the image of the points (N, 3) that it shows, in world units; `DISTANCE` if there are none.

    Of usual cameras it is known without a look at the points.
    """
    if camera.is_canonical:
        return DISTANCE
    depths = native.nearest_depth(cloud, camera, 0, SURVEY_CELL_PIXELS)
    seen = depths[np.isfinite(depths)]
    return float(np.median(seen)) if len(seen) else DISTANCE


def _front(cloud: np.ndarray, camera: Camera, pixels: float) -> np.ndarray:
    """Depths (h, w), in cells so many pixels wide, behind which nothing shows, infinite near empty cells."""
    nearest = native.nearest_depth(cloud, camera, 1, pixels)
    deepest = -native.window_minimum(np.negative(nearest), 3)
    return deepest + np.float32(FRONT_DEPTH_CELLS * pixels) * camera.pixel_width(deepest)
