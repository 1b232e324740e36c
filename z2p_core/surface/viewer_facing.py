"""Normals turned to face a viewer."""

from __future__ import annotations

import numpy as np

from z2p_core.linalg import row_dots

MAX_LINE_WIDTH = 1e-5
"""Width of a cloud over its length up to which it is a line: normals are then undefined around it."""

SAMPLED_FROM, LINE_SAMPLES = 10_000, 1000
"""Points from which on about so many of them are asked first whether they lie on a line."""


def line_direction(points: np.ndarray) -> np.ndarray | None:
    """Direction (3,) float32 of the line on which all points (N, 3) lie: 0 for a single point, None without one."""
    if len(points) < 2:
        return np.zeros(3, np.float32)
    if len(points) > SAMPLED_FROM and line_direction(points[:: len(points) // LINE_SAMPLES]) is None:
        return None
    offsets = (points - points[0]).astype(np.float64)
    squared_extents, axes = np.linalg.eigh(offsets.T @ offsets)
    is_line = squared_extents[1] <= MAX_LINE_WIDTH**2 * squared_extents[2]
    return axes[:, 2].astype(np.float32) if is_line else None


def face_viewer(points: np.ndarray, normals: np.ndarray, viewer: np.ndarray) -> np.ndarray:
    """Normals (N, 3) of points (N, 3), flipped where they point away from the viewer (3,).

    On a line, where any normal across it will do, they are turned towards the viewer as far as possible.
    """
    line = line_direction(points)
    if line is not None:
        view = viewer.astype(np.float32) - points
        view -= (view @ line)[:, None] * line
        return view / np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-6)
    faces_away = row_dots(points - viewer.astype(np.float32), normals) > 0
    return normals * np.where(faces_away, np.float32(-1), np.float32(1))[:, None]
