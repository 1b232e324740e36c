"""A shadow that the image's edge would cut is faded out towards the edge; the object itself never is."""

from __future__ import annotations

import numpy as np

FADE_WIDTH = 0.1
"""Width of the band along each edge in which a shadow fades, over the image's shorter side: the usual frame leaves this
much free."""
OPAQUE_ALPHA = 240
"""Alpha of 255 from which on a pixel belongs to the object. Shadows are fainter, except right below it."""
MIN_OBJECT_LIGHT = 0.35
"""Light of an opaque pixel, over that of its brightest neighbor, below which it is such a dark shadow."""


def fade_shadow(image: np.ndarray) -> np.ndarray:
    """The straight RGBA image (H, W, 4) uint8 with a shadow whose alpha falls to 0 at the edges.

    The object keeps its alpha: all of its opaque pixels, and its share of the pixels next to them.
    """
    height, width = image.shape[:2]
    down, across = (_fade_ramp(side, round(FADE_WIDTH * min(height, width))) for side in (height, width))
    rows, columns = _unfaded(down), _unfaded(across)
    result, object_share = image.copy(), None
    bands = (
        (slice(0, rows.start), slice(None)), (slice(rows.stop, None), slice(None)),
        (rows, slice(0, columns.start)), (rows, slice(columns.stop, None)),
    )  # fmt: skip
    for band in bands:  # the middle, which is most of the image, stays as it is
        kept, strip = np.outer(down[band[0]], across[band[1]]), image[band]
        if strip.size and strip[..., 3].max() >= OPAQUE_ALPHA:
            object_share = _object_share(image) if object_share is None else object_share
            result[band] = _fade_around_object(strip, kept, object_share[band])
        else:
            result[(*band, 3)] = strip[..., 3] * kept + np.float32(0.5)
    return result


def _fade_around_object(strip: np.ndarray, kept: np.ndarray, object_share: np.ndarray) -> np.ndarray:
    """A strip (H, W, 4) uint8 whose shadow is multiplied by `kept` (H, W), and whose object's share (H, W) stays.

    Shadow is black: where it fades, the remaining straight color is brighter.
    """
    alpha = strip[..., 3].astype(np.float32) / 255
    solid = np.minimum(object_share, alpha)
    faded_alpha = solid + (alpha - solid) * kept
    gain = np.divide(alpha, faded_alpha, out=np.ones_like(faded_alpha), where=faded_alpha > 0)
    color = np.minimum(strip[..., :3] * gain[..., None], 255)
    return (np.dstack([color, 255 * faded_alpha]) + np.float32(0.5)).astype(np.uint8)


def _fade_ramp(side: int, band: int) -> np.ndarray:
    """Share (side,) float32 of a shadow that is kept: 0 at both ends, 1 from `band` pixels on, smooth between."""
    distance = np.minimum(np.arange(side), np.arange(side)[::-1])
    share = np.minimum(distance / max(band, 1), 1).astype(np.float32)
    ramp: np.ndarray = share * share * (3 - 2 * share)
    return ramp


def _unfaded(ramp: np.ndarray) -> slice:
    """The range in which nothing fades; empty if a side has only a pixel or two."""
    kept = np.flatnonzero(ramp == 1)
    return slice(int(kept[0]), int(kept[-1]) + 1) if len(kept) else slice(0, 0)


def _object_share(image: np.ndarray) -> np.ndarray:
    """Share (H, W) float32 of each pixel that the object covers: 1 for opaque ones, estimated for those next to them.

    Such a pixel's premultiplied light, over that of the opaque pixels around it, is the object's share of it.
    """
    solid = image[..., 3] >= OPAQUE_ALPHA
    light = image[..., :3].max(2).astype(np.float32) * image[..., 3]
    solid &= light >= MIN_OBJECT_LIGHT * _dilate(_dilate(np.where(solid, light, 0)))  # else the dark shadow below it
    light_around, is_near = _dilate(np.where(solid, light, 0)), _dilate(solid)
    share = np.divide(light, light_around, out=np.ones_like(light), where=light_around > 0)
    return np.where(solid, 1, np.where(is_near, np.minimum(share, 1), 0)).astype(np.float32)


def _dilate(values: np.ndarray) -> np.ndarray:
    """Maximum (H, W) of each value and the eight around it."""
    rows = values.copy()
    np.maximum(rows[1:], values[:-1], out=rows[1:])
    np.maximum(rows[:-1], values[1:], out=rows[:-1])
    square = rows.copy()
    np.maximum(square[:, 1:], rows[:, :-1], out=square[:, 1:])
    np.maximum(square[:, :-1], rows[:, 1:], out=square[:, :-1])
    return square
