"""Subdivision of triangles into smaller ones in their plane, fine enough to give a texture at their corners."""

from __future__ import annotations

import numpy as np

MAX_TRIANGLES = 4_000_000
"""Most triangles after subdivision; of meshes with many long and thin ones the edges stay longer instead."""
EDGE_GROWTH = 1.25
"""Factor by which the longest edge is raised, until there are no more triangles than that."""


def subdivision_steps(corners: np.ndarray, max_edge: float) -> np.ndarray:
    """Parts (M,) int64 that the edges of triangles (M, 3, 3) are divided into, so that none is longer than `max_edge`.

    Edges are longer where there would be more than `MAX_TRIANGLES` triangles.
    """
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    while True:
        steps = np.maximum(np.ceil(edges / max_edge), 1)
        if (steps**2).sum() <= max(MAX_TRIANGLES, len(corners)) or steps.max() == 1:
            return steps.astype(np.int64)
        max_edge *= EDGE_GROWTH


def subdivide(corners: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Corners (K, 3, C) of the smaller triangles, K the sum of the squares of steps, grouped by steps in rising order.

    Args:
        corners: (M, 3, C): C values at each corner of a triangle, such as its position; they are interpolated linearly.
        steps: (M,) int, at least 1: a triangle becomes steps x steps equal ones of the same orientation.
    """
    parts = [np.empty((0, 3, corners.shape[2]), corners.dtype)]
    for count in np.unique(steps):
        weights = _barycentric_grid(int(count)).astype(corners.dtype)
        parts.append((weights.reshape(-1, 3) @ corners[steps == count]).reshape(-1, 3, corners.shape[2]))
    return np.concatenate(parts)


def _barycentric_grid(steps: int) -> np.ndarray:
    """Barycentric coordinates (steps^2, 3, 3) of the corners of a triangle's parts: part, corner, weight."""
    first, second = (index.ravel() for index in np.mgrid[:steps, :steps])
    upright = np.stack([(first, second), (first + 1, second), (first, second + 1)])[..., first + second < steps]
    inverted = np.stack([(first + 1, second), (first + 1, second + 1), (first, second + 1)])
    inverted = inverted[..., first + second < steps - 1]
    grid = np.concatenate([upright, inverted], axis=2).transpose(2, 0, 1) / steps
    return np.concatenate([1 - grid.sum(axis=2, keepdims=True), grid], axis=2)
