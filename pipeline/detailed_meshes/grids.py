"""Triangles between the vertices of a grid that is closed around itself, or of two grids back to back."""

from __future__ import annotations

import numpy as np

DECIMALS = 6
"""Digits to which vertices are rounded, so that machines whose sines differ in the last digit write the same bytes."""


def periodic_coordinates(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Parameters u (columns, 1) in [0, 1), which closes around itself, and v (1, rows) in [0, 1] with both ends."""
    return np.arange(columns)[:, None] / columns, np.linspace(0.0, 1.0, rows)[None]


def displace(points: np.ndarray, height: np.ndarray, closed_rows: bool = False) -> np.ndarray:
    """Grid (C, R, 3) of a surface closed along its first axis, moved by height (C, R) along its outward normals.

    With `closed_rows` the second axis is closed as well; else its ends are poles, which the normals' average moves.
    Outward is where the normal points when u runs counter-clockwise seen from +Z and v runs upwards.
    """
    along_u = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    neighbors = np.pad(points, ((0, 0), (1, 1), (0, 0)), mode="wrap" if closed_rows else "edge")
    along_v = neighbors[:, 2:] - neighbors[:, :-2]
    normals = np.cross(along_u, along_v)
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = normals / np.where(lengths > 0, lengths, 1.0)
    moved: np.ndarray = points + height[..., None] * normals
    return moved


def closed_tube(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64 and triangles (M, 3) int64 of a grid (C, R, 3) closed along both axes: a torus."""
    columns, rows = points.shape[:2]
    index = np.arange(columns * rows).reshape(columns, rows)
    index = np.pad(index, ((0, 1), (0, 1)), mode="wrap")
    return _rounded(points.reshape(-1, 3)), _triangles(index)


def closed_ball(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a grid (C, R, 3) closed along its first axis, whose first and last rows become points.

    Each of these two rows is replaced by one vertex in its middle.
    """
    columns, rows = points.shape[:2]
    inner = points[:, 1:-1].reshape(-1, 3)
    poles = np.stack([points[:, 0].mean(axis=0), points[:, -1].mean(axis=0)])
    index = np.arange(len(inner)).reshape(columns, rows - 2)
    index = np.pad(index, ((0, 1), (0, 0)), mode="wrap")
    this, following = index[:-1], index[1:]
    bottom = np.stack([np.full(columns, len(inner)), following[:, 0], this[:, 0]], axis=1)
    top = np.stack([np.full(columns, len(inner) + 1), this[:, -1], following[:, -1]], axis=1)
    return _rounded(np.concatenate([inner, poles])), np.concatenate([_triangles(index), bottom, top])


def closed_slab(upper: np.ndarray, lower: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of two grids (C, R, 3), one above the other, joined along their rims.

    Seen from above the upper one, its first axis runs to the right and its second one up.
    """
    columns, rows = upper.shape[:2]
    index = np.arange(columns * rows).reshape(columns, rows)
    rim = np.concatenate([index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]])
    ahead, below = np.roll(rim, -1), index.size
    sides = np.concatenate([np.stack([rim, rim + below, ahead + below], axis=1),
                            np.stack([rim, ahead + below, ahead], axis=1)])  # fmt: skip
    faces = _triangles(index)
    vertices = np.concatenate([upper.reshape(-1, 3), lower.reshape(-1, 3)])
    return _rounded(vertices), np.concatenate([faces, faces[:, ::-1] + below, sides])


def _triangles(index: np.ndarray) -> np.ndarray:
    """Two triangles (M, 3) int64 for each cell of a grid (C, R) of vertex indices, counter-clockwise."""
    a, b, c, d = (corner.ravel() for corner in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int64)


def _rounded(vertices: np.ndarray) -> np.ndarray:
    rounded: np.ndarray = np.round(vertices, DECIMALS) + 0.0  # no -0.0
    return rounded
