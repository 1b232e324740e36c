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
MAX_PYRAMID_LEVELS = 8
"""How often the image is halved at most to extend relative radiance beyond the outline."""


def apply_relative_radiance(image: np.ndarray, relative: np.ndarray, coverage: np.ndarray) -> None:
    """Multiply the color of an image (4, H, W), premultiplied sRGB and alpha, in linear light, in place.

    Args:
        image: float32.
        relative: (3, H, W) float32, linear; it counts by coverage.
        coverage: (H, W) float32 in [0, 1], the surface's share of each pixel.
    """
    factor = np.ones_like(relative)
    colored = image[3] > 0
    rows, columns = (np.flatnonzero(colored.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return
    window = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    factor[:, *window] = extend_by_pyramid(relative[:, *window], np.clip(coverage[window] / FULL_COVERAGE, 0, 1))
    native.multiply_linear(image, factor)


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


def extend_by_pyramid(values: np.ndarray, weights: np.ndarray, levels: int = MAX_PYRAMID_LEVELS) -> np.ndarray:
    """Values (C, H, W) where weights (H, W) are 1, elsewhere weighted means of values near them.

    Pull-push interpolation (Gortler et al., The Lumigraph, 1996). Weights lie in [0, 1].
    """
    height, width = weights.shape
    if not levels or max(height, width) < 2:
        mean = (values * weights).sum((1, 2), keepdims=True) / max(float(weights.sum()), 1e-6)
        return values * weights + mean * (1 - weights)
    padding = ((0, height % 2), (0, width % 2))
    coarse_weights = _sum_of_four(np.pad(weights, padding))
    coarse = _sum_of_four(np.pad(values * weights, ((0, 0), *padding))) / np.maximum(coarse_weights, 1e-6)
    coarse = extend_by_pyramid(coarse, np.minimum(coarse_weights, 1), levels - 1)
    finer = coarse.repeat(2, axis=1).repeat(2, axis=2)[:, :height, :width]
    return values * weights + finer * (1 - weights)


def _sum_of_four(image: np.ndarray) -> np.ndarray:
    """Sums (..., H / 2, W / 2) of the 2 x 2 blocks of an image (..., H, W)."""
    rows = image[..., ::2, :] + image[..., 1::2, :]
    total: np.ndarray = rows[..., ::2] + rows[..., 1::2]
    return total
