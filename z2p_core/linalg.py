"""Clouds turned and measured, by one thread each.

numpy's own products of matrices go to BLAS, which shares out those of a few thousand points; its threads then wait for
more work by spinning, a tenth of a second long, on the very core that the kernels and the network count on.
"""

from __future__ import annotations

import numpy as np


def turned(points: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Points (N, 3) after a rotation (3, 3), or what its first M rows (M, 3) make of them: (N, M)."""
    return np.einsum("na,ma->nm", points, rotation)


def along(points: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """How far points (N, 3) lie along an axis (3,): (N,)."""
    return np.einsum("na,a->n", points, axis)


def products(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Scalar products (N,) of vectors (N, 3) with as many others (N, 3)."""
    return np.einsum("na,na->n", first, second)


def extent(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest coordinates (3,) each of points (N, 3); numpy takes ten times as long along so short a row."""
    columns = np.ascontiguousarray(points.T)
    return columns.min(1), columns.max(1)
