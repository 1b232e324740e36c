"""Colors of points as files and libraries store them, converted to sRGB in [0, 1]; each kind of number is named."""

from __future__ import annotations

from types import EllipsisType

import numpy as np

SH_DEGREE_0 = 0.28209479177387814
"""The constant spherical harmonic of degree 0, by which Gaussian splats multiply the stored ``f_dc`` (3DGS)."""
ROUNDING_SHARE = 0.01
"""How far floats may lie outside [0, 1] and still be shares of full intensity: averages and interpolation round."""
PLAIN_NAN_BITS = 0x7FC00000
"""The bits of a float32 NaN as programs write it for a missing number; as a packed color it would be dark red."""


def srgb_from_numbers(values: np.ndarray) -> tuple[np.ndarray, str]:
    """sRGB colors (N, 3) float32 in [0, 1] of colors (N, 3 or more) of any numeric type, and what kind these are.

    Numbers to 1 are shares of full intensity, larger ones to 255 are 8-bit, and those above 16-bit, whatever their
    type: many writers put 8 bits into 16. Rows with a number that is not finite are NaN: their color is unknown.
    Channels behind the third are left out.

    Returns:
        The colors, and the kind in a few words; empty if the numbers can be no colors: negative, above 65535, or none.
    """
    values = np.asarray(values)[:, :3]
    known = _finite_rows(values)
    if known is None:
        return np.full(values.shape, np.nan, dtype=np.float32), ""
    finite = values if known is ... else values[known]
    largest, smallest = float(finite.max()), float(finite.min())
    if smallest < (-ROUNDING_SHARE if values.dtype.kind == "f" else 0) or largest > 65535:
        return np.full(values.shape, np.nan, dtype=np.float32), ""
    scale, kind = _scale_of(values.dtype, largest)
    srgb = np.asarray(values, dtype=np.float32) / np.float32(scale)
    if known is not ...:
        srgb[~known] = np.nan
    return np.clip(srgb, 0, 1, out=srgb) if smallest < 0 or largest > scale else srgb, kind


def srgb_from_packed(values: np.ndarray) -> np.ndarray:
    """sRGB colors (N, 3) float32 of ``0xAARRGGBB`` in 4 bytes, as the Point Cloud Library packs them.

    `values` (N,) are float32 or 4-byte integers whose bits are the color, float64 that were such float32, or whole
    numbers of another type. A plain NaN is an unknown color.
    """
    values = np.ascontiguousarray(values)
    if values.dtype.kind == "f" and values.dtype.itemsize == 8 and not _are_4_byte_integers(values):
        values = values.astype(np.float32)
    if values.dtype.itemsize == 4:
        bits = values.view(np.uint32) if values.dtype.isnative else values.byteswap().view(np.uint32)
    else:
        bits = np.nan_to_num(values).astype(np.int64).astype(np.uint32)
    channels = np.column_stack([bits >> shift & 255 for shift in (16, 8, 0)])
    srgb = channels.astype(np.float32) / np.float32(255)
    if values.dtype.kind == "f":
        srgb[bits == PLAIN_NAN_BITS] = np.nan
    return srgb


def srgb_from_sh(dc: np.ndarray) -> np.ndarray:
    """sRGB colors (N, 3) float32 in [0, 1] of the coefficients ``f_dc`` (N, 3) of Gaussian splats (3DGS, degree 0)."""
    return np.clip(0.5 + SH_DEGREE_0 * np.asarray(dc, dtype=np.float32), 0, 1)


def _are_4_byte_integers(values: np.ndarray) -> bool:
    """Whether all finite floats (N,) are whole numbers of 4 bytes, with a sign or without."""
    finite = values[np.isfinite(values)]
    return finite.size > 0 and bool(((finite == np.floor(finite)) & (finite >= -(2**31)) & (finite < 2**32)).all())


def _finite_rows(values: np.ndarray) -> np.ndarray | EllipsisType | None:
    """Which rows of numbers (N, C) are finite, (N,): ``...`` for all, None for none."""
    if values.size and np.isfinite(values.min()) and np.isfinite(values.max()):
        return ...
    known = np.isfinite(values).all(axis=1)
    return known if known.any() else None


def _scale_of(dtype: np.dtype, largest: float) -> tuple[float, str]:
    """What full intensity is for numbers of a type up to `largest`, and their kind in words."""
    if largest > 255:
        return 65535.0, "16-bit"
    if largest > (1 + ROUNDING_SHARE if dtype.kind == "f" else 1):
        is_wider = dtype.kind in "iu" and dtype.itemsize == 2
        return 255.0, "8-bit, in 16-bit integers" if is_wider else "8-bit"
    return 1.0, "shares of 1"
