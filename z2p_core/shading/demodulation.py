"""Multiplies a finished picture by the radiance of a textured surface over that of the neutral one it shows.

This is the last step of albedo demodulation, as denoisers of path tracers use it (Schied et al., Spatiotemporal
Variance-Guided Filtering, 2017): light is filtered, texture is not.
"""

from __future__ import annotations

import numpy as np

from z2p_core import native
from z2p_core.images import linear_from_srgb, srgb_from_linear

FULL_COVERAGE = 0.25
"""Coverage of a pixel from which on its own relative radiance counts in full; below, that of its surroundings does."""


def apply_relative_radiance(image: np.ndarray, relative: np.ndarray, coverage: np.ndarray) -> None:
    """Multiply the color of an image (4, H, W), premultiplied sRGB and alpha, in linear light, in place.

    Args:
        image: float32.
        relative: (3, H, W) float32, linear; it counts by coverage.
        coverage: (H, W) float32 in [0, 1], the surface's share of each pixel.
    """
    native.multiply_linear(image, relative, coverage, FULL_COVERAGE)


def radiance_factors(relative: np.ndarray) -> np.ndarray:
    """Factors (3, H, W) float32 by which `apply_relative_radiance` multiplies an image, for training through it.

    `relative` (4, H, W) float32 has the relative radiance and the coverage, as `GBuffer.draw_textured_into` returns.
    """
    colors, coverage = relative[:3], relative[3]
    height, width = coverage.shape
    coarse = native.extend_halved(colors, coverage, 1 / FULL_COVERAGE)
    wide = coarse.repeat(2, axis=1).repeat(2, axis=2)[:, :height, :width]
    share = np.clip(coverage / FULL_COVERAGE, 0, 1)
    factors: np.ndarray = wide + share * (colors - wide)
    return factors


def reduce_light(image: np.ndarray, color: np.ndarray, coverage: np.ndarray, share: float) -> None:
    """Blend the surface in an image (4, H, W), premultiplied sRGB and alpha, with one color in linear light, in place.

    Args:
        image: float32.
        color: (3,) linear.
        coverage: (H, W) float32 in [0, 1], the surface's share of each pixel; the floor's shadow stays.
        share: how much of the light stays, 0 to 1.
    """
    rows, columns = np.nonzero((coverage > 0) & (image[3] > 0))
    pixels = image[:, rows, columns]
    alpha = pixels[3]
    weight = (1 - share) * np.minimum(coverage[rows, columns] / alpha, 1)
    lit = linear_from_srgb(np.clip(pixels[:3] / alpha, 0, 1))
    mixed = lit + weight * (color[:, None] - lit)
    image[:3, rows, columns] = srgb_from_linear(mixed) * alpha
