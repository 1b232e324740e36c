"""Colors of a mesh's vertices from those of a cloud's points."""

from __future__ import annotations

import numpy as np

from z2p_core import native
from z2p_core.linalg import row_dots

NEIGHBORS = 4
"""Points around a vertex whose colors are averaged."""
MIN_SQUARED_DISTANCE = 1e-10
"""Squared distance, in world units, below which a vertex is at a point and has its color."""


def interpolate_colors(vertices: np.ndarray, cloud: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Colors (V, 3) float32 at vertices (V, 3): means over the nearest points, by inverse squared distance.

    Args:
        vertices: finite, in the units of the cloud.
        cloud: points (N, 3), N >= 1.
        colors: (N, 3), one a point. Points at one place share the mean of theirs.
    """
    points, number = np.unique(np.asarray(cloud, np.float32), axis=0, return_inverse=True)
    number = number.reshape(-1)
    count = np.bincount(number, minlength=len(points))
    means = np.stack([np.bincount(number, channel, len(points)) / count for channel in colors.T], axis=1)
    grid = native.NeighborGrid(points)
    sorted_index = np.lexsort(grid.points.T[::-1])  # np.unique sorts rows by their first column, then the next ones
    order = np.empty_like(sorted_index)
    order[sorted_index] = np.arange(len(points))
    nearest = grid.neighbors_of_positions(vertices, min(NEIGHBORS, len(points)))
    total, weight = np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    for column in nearest.T:
        offsets = grid.points[column] - np.asarray(vertices, np.float32)
        share = 1 / np.maximum(row_dots(offsets, offsets), MIN_SQUARED_DISTANCE).astype(np.float64)
        total += share[:, None] * means[order[column]]
        weight += share
    return (total / weight[:, None]).astype(np.float32)
