"""Flicker: how much the frames of a loop change otherwise than the true frames do."""

from __future__ import annotations

import numpy as np

from z2p_core.images import composite, unit_from_bytes

WHITE = (1.0, 1.0, 1.0)


def flicker(frames: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Mean absolute error of the change from each frame to the next, in levels of 255; 0 if both loops change alike.

    Args:
        frames: (T, H, W, 4) uint8, straight RGBA, composited over white.
        truth: the true frames, of the same shape and kind.
        mask: (T, H, W) bool, True on the object. A pixel counts if it is on the object in either of two frames.

    A constant error of the pictures does not count.
    """
    change = np.diff(_over_white(frames), axis=0)
    true_change = np.diff(_over_white(truth), axis=0)
    error = np.abs(change - true_change).mean(-1)
    return float(255 * error[mask[1:] | mask[:-1]].mean())


def _over_white(frames: np.ndarray) -> np.ndarray:
    """Frames (T, H, W, 4) uint8 as RGB in [0, 1], composited over white."""
    return np.stack([composite(unit_from_bytes(frame), WHITE) for frame in frames])
