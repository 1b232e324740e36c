"""Rotation matrices of quaternions, as formats of scans and models keep the turn of a camera.

`z2p_core.placement.bounding_sphere.random_rotation` reckons the same for itself: renders would have to be made again if it changed.
"""

from __future__ import annotations

import numpy as np


def quaternion_rotations(quaternions: np.ndarray) -> np.ndarray:
    """Rotation matrices (N, 3, 3) float64 of unit quaternions (N, 4) in the order w, x, y, z."""
    w, x, y, z = quaternions.T
    return np.stack([
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], -1),
        np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], -1),
        np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], -1),
    ], 1)  # fmt: skip
