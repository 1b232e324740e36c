"""Sparse clouds are drawn small and enlarged: the network closes gaps of some pixels, as it has learnt to, not of many.

How much smaller was measured on clouds of 100 to 5,000 points in pictures of 256 to 1024 pixels: `docs/ablations.md`.
"""

from __future__ import annotations

import math

import numpy as np

from z2p_core.camera import DISTANCE, Camera
from z2p_core.parallel import parallel_rows
from z2p_core.surface.noise_level import median_spacing
from z2p_core.surface.subsampling import MAX_SURFACE_POINTS

MIN_PIXELS_PER_SPACING = 6.0
"""Pixels from point to point, at least, in a picture that is drawn smaller."""
REDUCTION_FACTORS = (2, 3, 4, 6, 8, 12, 16)
"""How many times smaller: few, for engines prepare for each size of picture."""
MIN_SHORTER_SIDE = 128
"""Of a picture's shorter side: below, the network sees too little."""


def render_size(cloud: np.ndarray, width: int, height: int) -> tuple[int, int]:
    """Width and height in which a picture of a placed cloud (N, 3) float32 is drawn, at most those that it shall have.

    They depend on the distance between the cloud's points, not on how it is turned.
    """
    scale = Camera(width, height).focal / DISTANCE
    near = 4 * math.pi * (scale / (REDUCTION_FACTORS[0] * MIN_PIXELS_PER_SPACING)) ** 2  # so many points are close all over the unit sphere
    if min(len(cloud), MAX_SURFACE_POINTS) >= near:
        return width, height
    apart = scale * median_spacing(cloud)
    small = min(width, height) / MIN_SHORTER_SIDE
    factor = max((step for step in REDUCTION_FACTORS if apart >= MIN_PIXELS_PER_SPACING * step and small >= step), default=1)
    return round(width / factor), round(height / factor)


def upsampled(picture: np.ndarray, width: int, height: int) -> np.ndarray:
    """A picture (C, h, w) float32, colour times alpha, in another size (C, height, width): bicubic, so somewhat beyond
    its range."""
    if picture.shape[1:] == (height, width):
        return picture
    from PIL import Image  # late: few pictures are enlarged

    out = np.empty((len(picture), height, width), np.float32)

    def resize(begin: int, end: int) -> None:
        for plane in range(begin, end):
            out[plane] = Image.fromarray(picture[plane]).resize((width, height), Image.Resampling.BICUBIC)

    parallel_rows(resize, len(picture), smallest=2, parts=len(picture))
    return out
