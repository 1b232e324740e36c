"""A shadow ends softly at the picture's edge, where it would be cut straight; the object is never faded."""

from __future__ import annotations

import numpy as np

FADE_WIDTH = 0.1
"""Share of the shorter side, along each edge, within which a shadow fades: what the usual frame leaves free."""
OPAQUE_ALPHA = 240
"""Alpha, of 255, from which on a pixel belongs to the object; a shadow is lighter but for right below it."""
DARKEST_OBJECT = 0.35
"""Light of a solid pixel, in that of its brightest neighbour, below which it is such a shadow."""


def fade_shadow(picture: np.ndarray) -> np.ndarray:
    """A straight RGBA picture (H, W, 4) uint8 whose alpha falls to 0 at its edges, the object's excepted.

    The object is what is solid, and its share of the pixels beside that.
    """
    height, width = picture.shape[:2]
    down, across = (_ramp(side, round(FADE_WIDTH * min(height, width))) for side in (height, width))
    rows, columns = _unfaded(down), _unfaded(across)
    result, share = picture.copy(), None
    parts = (
        (slice(0, rows.start), slice(None)), (slice(rows.stop, None), slice(None)),
        (rows, slice(0, columns.start)), (rows, slice(columns.stop, None)),
    )  # fmt: skip
    for part in parts:  # the middle, most of it, stays as it is
        kept, strip = np.outer(down[part[0]], across[part[1]]), picture[part]
        if strip.size and strip[..., 3].max() >= OPAQUE_ALPHA:
            share = _object_share(picture) if share is None else share
            result[part] = _faded_beside(strip, kept, share[part])
        else:
            result[(*part, 3)] = strip[..., 3] * kept + np.float32(0.5)
    return result


def _faded_beside(strip: np.ndarray, kept: np.ndarray, share: np.ndarray) -> np.ndarray:
    """A strip (H, W, 4) uint8 of which the shadow is kept so far, and the object in full, which has a share of it.

    A shadow is black: where it goes, the colour that is left is brighter.
    """
    alpha = strip[..., 3].astype(np.float32) / 255
    solid = np.minimum(share, alpha)
    left = solid + (alpha - solid) * kept
    brighter = np.divide(alpha, left, out=np.ones_like(left), where=left > 0)
    color = np.minimum(strip[..., :3] * brighter[..., None], 255)
    return (np.dstack([color, 255 * left]) + np.float32(0.5)).astype(np.uint8)


def _ramp(side: int, band: int) -> np.ndarray:
    """What is left of a shadow (side,) float32: 0 at both ends, 1 from `band` pixels on, smooth at both."""
    away = np.minimum(np.arange(side), np.arange(side)[::-1])
    share = np.minimum(away / max(band, 1), 1).astype(np.float32)
    ramp: np.ndarray = share * share * (3 - 2 * share)
    return ramp


def _unfaded(ramp: np.ndarray) -> slice:
    """Where nothing fades; nowhere, of a side of a pixel or two."""
    whole = np.flatnonzero(ramp == 1)
    return slice(int(whole[0]), int(whole[-1]) + 1) if len(whole) else slice(0, 0)


def _object_share(picture: np.ndarray) -> np.ndarray:
    """How much of each pixel (H, W) float32 is the object's: all of solid ones, of those beside what their light tells.

    Such a pixel is as bright, next to the solid ones around it, as the object's share of it is large.
    """
    solid = picture[..., 3] >= OPAQUE_ALPHA
    light = picture[..., :3].max(2).astype(np.float32) * picture[..., 3]
    solid &= light >= DARKEST_OBJECT * _dilated(_dilated(np.where(solid, light, 0)))  # else the shadow right below it
    around, beside = _dilated(np.where(solid, light, 0)), _dilated(solid)
    share = np.divide(light, around, out=np.ones_like(light), where=around > 0)
    return np.where(solid, 1, np.where(beside, np.minimum(share, 1), 0)).astype(np.float32)


def _dilated(values: np.ndarray) -> np.ndarray:
    """The largest of each value (H, W) and the eight around it."""
    wide = values.copy()
    np.maximum(wide[1:], values[:-1], out=wide[1:])
    np.maximum(wide[:-1], values[1:], out=wide[:-1])
    high = wide.copy()
    np.maximum(high[:, 1:], wide[:, :-1], out=high[:, 1:])
    np.maximum(high[:, :-1], wide[:, 1:], out=high[:, :-1])
    return high
