"""A shadow ends softly at the picture's edge, where it would be cut straight; the object is never faded."""

from __future__ import annotations

import numpy as np

BAND = 0.1
"""Share of the shorter side, along each edge, within which a shadow fades: what the usual frame leaves free."""
SOLID = 240
"""Alpha, of 255, from which on a pixel belongs to the object; a shadow is lighter but for right below it."""


def faded(picture: np.ndarray) -> np.ndarray:
    """A straight RGBA picture (H, W, 4) uint8 whose alpha falls to 0 at its edges, the object's excepted.

    The object is what is solid, and the pixels beside it, which its outline shares with the background.
    """
    height, width = picture.shape[:2]
    down, across = (_ramp(side, round(BAND * min(height, width))) for side in (height, width))
    (rows, columns), alpha = (_within(ramp) for ramp in (down, across)), picture[..., 3]
    result = picture.copy()
    parts = (
        (slice(0, rows.start), slice(None)), (slice(rows.stop, None), slice(None)),
        (rows, slice(0, columns.start)), (rows, slice(columns.stop, None)),
    )  # fmt: skip
    for part in parts:  # the middle, most of it, stays as it is
        kept = np.outer(down[part[0]], across[part[1]])
        strip = alpha[part]
        if strip.size and strip.max() >= SOLID:
            kept[_beside(alpha >= SOLID)[part]] = 1.0
        result[(*part, 3)] = strip * kept + np.float32(0.5)
    return result


def _ramp(side: int, band: int) -> np.ndarray:
    """What is left of a shadow (side,) float32: 0 at both ends, 1 from `band` pixels on, smooth at both."""
    away = np.minimum(np.arange(side), np.arange(side)[::-1])
    share = np.minimum(away / max(band, 1), 1).astype(np.float32)
    ramp: np.ndarray = share * share * (3 - 2 * share)
    return ramp


def _within(ramp: np.ndarray) -> slice:
    """Where nothing fades; nowhere, of a side of a pixel or two."""
    whole = np.flatnonzero(ramp == 1)
    return slice(int(whole[0]), int(whole[-1]) + 1) if len(whole) else slice(0, 0)


def _beside(solid: np.ndarray) -> np.ndarray:
    """The solid pixels (H, W) and those beside them."""
    wide = solid.copy()
    wide[1:] |= solid[:-1]
    wide[:-1] |= solid[1:]
    high = wide.copy()
    high[:, 1:] |= wide[:, :-1]
    high[:, :-1] |= wide[:, 1:]
    return high
