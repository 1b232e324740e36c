"""Colour and alpha: sRGB and linear light, straight and premultiplied, pictures made smaller.

Files and the interface carry sRGB with straight alpha, RGB order, HxWx4 uint8. The network and its losses work on sRGB
values times alpha (premultiplied float32 in [0, 1]). Averaging happens in linear light, premultiplied.
"""

from __future__ import annotations

import numpy as np


def linear_from_srgb(srgb: np.ndarray | float) -> np.ndarray:
    """Linear light of sRGB values in [0, 1] (IEC 61966-2-1), same shape."""
    srgb = np.asarray(srgb)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.04045) + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(linear: np.ndarray | float) -> np.ndarray:
    """sRGB values of linear light, same shape; light above 1 stays above 1."""
    linear = np.asarray(linear)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def bytes_from_unit(picture: np.ndarray) -> np.ndarray:
    """uint8 of values in [0, 1], rounded to nearest and clipped, same shape."""
    return (np.clip(picture, 0.0, 1.0) * 255 + 0.5).astype(np.uint8)


def unit_from_bytes(picture: np.ndarray) -> np.ndarray:
    """float32 in [0, 1] of uint8 values, same shape."""
    return picture.astype(np.float32) / 255


def straight_from_premultiplied(picture: np.ndarray) -> np.ndarray:
    """RGBA (..., 4) with straight colour, from colour times alpha; colour 0 where alpha is 0."""
    alpha = picture[..., 3:]
    color = np.divide(picture[..., :3], alpha, out=np.zeros_like(picture[..., :3]), where=alpha > 1e-6)
    return np.concatenate([np.clip(color, 0.0, 1.0), alpha], axis=-1)


def premultiplied_from_straight(picture: np.ndarray) -> np.ndarray:
    """RGBA (..., 4) with colour times alpha, from straight colour."""
    return np.concatenate([picture[..., :3] * picture[..., 3:], picture[..., 3:]], axis=-1)


def composite(picture: np.ndarray, background: tuple[float, float, float]) -> np.ndarray:
    """Opaque RGB (..., 3) in [0, 1] of a straight RGBA picture in [0, 1] over a background, on sRGB values."""
    alpha = picture[..., 3:]
    return picture[..., :3] * alpha + np.asarray(background, dtype=picture.dtype) * (1 - alpha)


def shrink(picture: np.ndarray, factor: int) -> np.ndarray:
    """Straight sRGB RGBA (H/factor, W/factor, 4) float32, area-averaged in linear premultiplied light.

    `picture` is straight sRGB (H, W, 4) float in [0, 1]; both sides must be multiples of `factor`.
    """
    linear = np.concatenate([linear_from_srgb(picture[..., :3]), picture[..., 3:]], axis=-1)
    averaged = straight_from_premultiplied(area_average(premultiplied_from_straight(linear), factor))
    return np.concatenate([srgb_from_linear(averaged[..., :3]), averaged[..., 3:]], axis=-1).astype(np.float32)


def area_average(picture: np.ndarray, factor: int) -> np.ndarray:
    """Means of factor x factor blocks of (H, W) or (H, W, C)."""
    height, width = picture.shape[:2]
    if height % factor or width % factor:
        raise ValueError(f"expected sides that are multiples of {factor}, got {width}x{height}")
    blocks = picture.reshape(height // factor, factor, width // factor, factor, *picture.shape[2:])
    return blocks.mean(axis=(1, 3))
