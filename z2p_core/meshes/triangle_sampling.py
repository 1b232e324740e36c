"""Uniform sampling of points on the triangles of a mesh; every sampler plugin starts from it."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import ScanError


def triangle_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Areas (M,) float64 of triangles faces (M, 3) int of vertices (V, 3), in the vertices' unit squared."""
    corners = _corners(vertices, faces)
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2


def sample_uniform(vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Exactly `count` points (count, 3) float64, uniformly distributed over the triangles' area.

    Triangles of area 0 get no points. The same generator state gives the same bytes.

    Raises:
        ScanError: `count` is below 1, or no triangle has a finite area above 0.
    """
    if count < 1:
        raise ScanError(f"expected at least 1 point to sample, got {count}")
    cumulative_areas = np.cumsum(triangle_areas(vertices, faces))
    total = float(cumulative_areas[-1]) if len(cumulative_areas) else 0.0
    if not 0 < total < np.inf:
        raise ScanError(
            f"expected triangles with a finite area above 0, got {len(faces)} whose area is {total:g}; repair the mesh"
        )
    # 'right' skips triangles of area 0, even if the random number is exactly 0
    chosen = np.searchsorted(cumulative_areas, rng.random(count) * total, side="right")
    chosen = np.minimum(chosen, np.searchsorted(cumulative_areas, total, side="left"))
    corners = _corners(vertices, faces[chosen])
    # the square root makes the density uniform over a triangle (Osada et al. 2002)
    root, along = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    first, second = root * (1 - along), root * along
    edges = corners[:, 1:] - corners[:, :1]
    return corners[:, 0] + first * edges[:, 0] + second * edges[:, 1]


def _corners(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Corners (M, 3, 3) float64: triangle, corner, axis."""
    return np.asarray(vertices, dtype=np.float64)[np.asarray(faces, dtype=np.int64).reshape(-1, 3)]
