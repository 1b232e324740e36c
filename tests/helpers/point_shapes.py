"""Clouds of shapes whose normals, spacing and shadows are known."""

from __future__ import annotations

import numpy as np


def sphere_of(count: int, seed: int = 0, radius: float = 1.0) -> np.ndarray:
    """Points (count, 3) float32, random and even on a sphere about the origin."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return (radius * points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)


def square_of(count: int, half: float, height: float, seed: int = 0) -> np.ndarray:
    """Points (count, 3) float32, random on a level square that reaches `half` to each side of the z axis."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-half, half, (count, 2)), np.full(count, height)]).astype(np.float32)
