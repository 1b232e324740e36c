"""Products of small matrices with whole clouds, and their bounding boxes, each computed by the calling thread alone.

numpy's own matrix products go to BLAS, which splits those of a few thousand points across its threads. These then spin
for a tenth of a second while they wait for more work, on the very core that the kernels and the network need.
"""

from __future__ import annotations

import numpy as np

CHUNK_POINTS = 1 << 14
"""Points whose bounding box is computed at a time: their coordinates fit the processor's cache."""


def rotate_points(points: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Points (N, 3) multiplied by a rotation (3, 3), or by its first M rows (M, 3): (N, M)."""
    return np.einsum("na,ma->nm", points, rotation)


def dot_axis(points: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Scalar products (N,) of points (N, 3) with one axis (3,)."""
    return np.einsum("na,a->n", points, axis)


def row_dots(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Scalar products (N,) of vectors (N, 3) with the vectors (N, 3) in the same rows."""
    return np.einsum("na,na->n", first, second)


def bounding_box(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest coordinates (3,) each of points (N, 3), N >= 1.

    Reduces transposed chunks: ``points.min(axis=0)`` takes ten times as long along rows of three numbers.
    """
    lows, highs = [], []
    for start in range(0, len(points), CHUNK_POINTS):
        columns = np.ascontiguousarray(points[start : start + CHUNK_POINTS].T)
        lows.append(columns.min(1))
        highs.append(columns.max(1))
    return np.min(lows, axis=0), np.max(highs, axis=0)
