"""Color and alpha of images: sRGB and linear light, straight and premultiplied alpha, downsampling.

Files and the public interface use sRGB with straight alpha, (H, W, 4) uint8 in the order RGBA. The network and its
losses use sRGB values times alpha, float32 in [0, 1] (premultiplied). Averages are taken of premultiplied linear light.
"""

from __future__ import annotations

import numpy as np


def linear_from_srgb(srgb: np.ndarray | float) -> np.ndarray:
    """Linear light of sRGB values in [0, 1], same shape (IEC 61966-2-1)."""
    srgb = np.asarray(srgb)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.04045) + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(linear: np.ndarray | float) -> np.ndarray:
    """sRGB values of linear light, same shape; values above 1 stay above 1."""
    linear = np.asarray(linear)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def bytes_from_unit(image: np.ndarray) -> np.ndarray:
    """uint8 of values in [0, 1], clipped and rounded to nearest, same shape."""
    return (np.clip(image, 0.0, 1.0) * 255 + 0.5).astype(np.uint8)


def unit_from_bytes(image: np.ndarray) -> np.ndarray:
    """float32 in [0, 1] of uint8 values, same shape."""
    return image.astype(np.float32) / 255


def straight_from_premultiplied(image: np.ndarray) -> np.ndarray:
    """Straight RGBA (..., 4) of premultiplied RGBA; color is 0 where alpha is."""
    alpha = image[..., 3:]
    color = np.divide(image[..., :3], alpha, out=np.zeros_like(image[..., :3]), where=alpha > 1e-6)
    return np.concatenate([np.clip(color, 0.0, 1.0), alpha], axis=-1)


def premultiplied_from_straight(image: np.ndarray) -> np.ndarray:
    """Premultiplied RGBA (..., 4) of straight RGBA."""
    return np.concatenate([image[..., :3] * image[..., 3:], image[..., 3:]], axis=-1)


def composite(image: np.ndarray, background: tuple[float, float, float]) -> np.ndarray:
    """RGB (..., 3) of a straight RGBA image over a background (3,), all sRGB values in [0, 1]."""
    alpha = image[..., 3:]
    return image[..., :3] * alpha + np.asarray(background, dtype=image.dtype) * (1 - alpha)


def shrink(image: np.ndarray, factor: int) -> np.ndarray:
    """The image (H/factor, W/factor, 4) float32, averaged over areas in premultiplied linear light.

    `image` (H, W, 4) and the result are straight sRGB RGBA in [0, 1].

    Raises:
        ValueError: a side is not a multiple of the factor.
    """
    linear = np.concatenate([linear_from_srgb(image[..., :3]), image[..., 3:]], axis=-1)
    averaged = straight_from_premultiplied(area_average(premultiplied_from_straight(linear), factor))
    return np.concatenate([srgb_from_linear(averaged[..., :3]), averaged[..., 3:]], axis=-1).astype(np.float32)


def area_average(image: np.ndarray, factor: int) -> np.ndarray:
    """Means of the factor x factor blocks of an image (H, W) or (H, W, C), whose shape is (H/factor, W/factor, ...).

    Raises:
        ValueError: a side is not a multiple of the factor.
    """
    height, width = image.shape[:2]
    if height % factor or width % factor:
        raise ValueError(f"expected sides that are multiples of {factor}, got {width}x{height}")
    blocks = image.reshape(height // factor, factor, width // factor, factor, *image.shape[2:])
    return blocks.mean(axis=(1, 3))
