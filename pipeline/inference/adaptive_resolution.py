"""Sparse clouds are rendered at a lower resolution and upsampled: the network closes gaps of a few pixels only.

The factors were measured on clouds of 100 to 5,000 points in pictures of 256 to 1024 pixels: `docs/ablations.md`.
"""

from __future__ import annotations

import math

import numpy as np

from z2p_core.camera import DISTANCE, Camera
from z2p_core.parallel import parallel_rows
from z2p_core.placement.placed_camera import FRAME_PER_FOCAL, PlacedCamera
from z2p_core.surface.noise_level import median_spacing
from z2p_core.surface.subsampling import MAX_SURFACE_POINTS

MIN_PIXELS_PER_SPACING = 6.0
"""Distance between neighboring points, in pixels, that a picture at lower resolution still has."""
REDUCTION_FACTORS = (2, 3, 4, 6, 8, 12, 16)
"""Factors by which sides are divided; few, since engines prepare for each size of picture."""
MIN_SHORTER_SIDE = 128
"""Shorter side of the smallest picture that the network renders, in pixels."""


def render_size(cloud: np.ndarray, width: int, height: int, reduction: int | None = None) -> tuple[int, int]:
    """Width and height at which the network renders a placed cloud (N, 3), at most those of the picture.

    They depend on the distance between the cloud's points, not on its rotation. A `reduction` divides them instead.
    """
    factor = reduction_factor(cloud, width, height) if reduction is None else reduction
    return round(width / factor), round(height / factor)


def reduction_factor(cloud: np.ndarray, width: int, height: int) -> int:
    """The factor by which the sides of a placed cloud's (N, 3) picture are divided; 1 for dense clouds."""
    pixels_per_unit = Camera(width, height).focal / DISTANCE
    # with so many points, neighbors are close even if the points are spread over the whole unit sphere
    dense = 4 * math.pi * (pixels_per_unit / (REDUCTION_FACTORS[0] * MIN_PIXELS_PER_SPACING)) ** 2
    if min(len(cloud), MAX_SURFACE_POINTS) >= dense:
        return 1
    spacing = pixels_per_unit * median_spacing(cloud)
    max_factor = min(width, height) / MIN_SHORTER_SIDE
    suitable = [f for f in REDUCTION_FACTORS if spacing >= MIN_PIXELS_PER_SPACING * f and max_factor >= f]
    return max(suitable, default=1)


def placed_render_size(cloud: np.ndarray, camera: PlacedCamera) -> tuple[int, int]:
    """Width and height at which the network renders a cloud (N, 3) as any camera sees it; see `render_size`."""
    frame = round(FRAME_PER_FOCAL * camera.pixels_per_unit)
    factor = max(1.0, frame / max(render_size(cloud, frame, frame)[0], 1))
    factor = min(factor, max(1.0, min(camera.width, camera.height) / MIN_SHORTER_SIDE))
    return round(camera.width / factor), round(camera.height / factor)


def upsampled(picture: np.ndarray, width: int, height: int) -> np.ndarray:
    """A premultiplied image (C, h, w) float32 at another size, (C, height, width); bicubic, so it may overshoot."""
    if picture.shape[1:] == (height, width):
        return picture
    from PIL import Image  # imported late: few pictures are upsampled

    out = np.empty((len(picture), height, width), np.float32)

    def resize(begin: int, end: int) -> None:
        for plane in range(begin, end):
            out[plane] = Image.fromarray(picture[plane]).resize((width, height), Image.Resampling.BICUBIC)

    parallel_rows(resize, len(picture), smallest=2, parts=len(picture))
    return out
