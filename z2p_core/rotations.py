"""Rotation matrices (3, 3), which multiply column vectors: from quaternions, at random, and onto the vertical."""

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


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """Rotation matrix (3, 3) uniform over all rotations, from a random unit quaternion (Shoemake, 1992)."""
    quaternion = rng.normal(size=4)
    rotation: np.ndarray = quaternion_rotations((quaternion / np.linalg.norm(quaternion))[None])[0]
    return rotation


def align_to_vertical(rotation: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """A rotation (3, 3), followed by the smallest one that brings the data's direction `normal` (3,) to +Z.

    Rodrigues' formula. A normal that already points along Z, up or down, leaves the rotation as it is.
    """
    direction = rotation @ normal
    axis = np.cross(direction, [0.0, 0.0, 1.0])
    sin, cos = float(np.linalg.norm(axis)), float(direction[2])
    if sin < 1e-12:
        return rotation
    x, y, z = axis / sin
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    aligned: np.ndarray = (np.eye(3) + sin * cross + (1 - cos) * cross @ cross) @ rotation
    return aligned
