"""Meshes for the sample scans: an amphora, a chair and a knot on its plinth, from formulas alone."""

from __future__ import annotations

import numpy as np

Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices (V, 3) float64, +Z up, front to -Y; and triangles (M, 3) int64."""


def amphora() -> Mesh:
    """Body of revolution with a foot, a neck and a lip, and two handles."""
    profile = np.array(  # radius, height; the inside of the neck comes back down
        [(0, 0), (0.22, 0), (0.25, 0.03), (0.2, 0.08), (0.13, 0.14), (0.2, 0.24), (0.38, 0.45), (0.5, 0.72),
         (0.53, 0.95), (0.47, 1.17), (0.33, 1.32), (0.19, 1.42), (0.15, 1.55), (0.15, 1.7), (0.19, 1.8), (0.25, 1.84),
         (0.25, 1.88), (0.2, 1.88), (0.13, 1.78), (0.11, 1.5), (0.12, 1.35)]
    )
    smooth = _spline(profile, 160)
    around = np.linspace(0, 2 * np.pi, 121)
    radius, height = smooth[:, :1], smooth[:, 1:]
    body = _grid(np.stack([radius * np.cos(around), radius * np.sin(around), np.broadcast_to(height, (160, 121))], -1))
    handle = np.array([(0.14, 1.68), (0.3, 1.74), (0.46, 1.66), (0.53, 1.45), (0.5, 1.22), (0.4, 1.1)])
    path = _spline(handle, 80)
    line = np.stack([path[:, 0], np.zeros(80), path[:, 1]], axis=-1)
    return join(body, _tube(line, 0.045), _tube(line * (-1, 1, 1), 0.045))


def chair() -> Mesh:
    """Seat, four splayed legs with stretchers, and a back of slats between two posts."""
    parts = [_box((0, 0, 0.47), (0.25, 0.24, 0.022))]
    for x in (-1, 1):
        for y in (-1, 1):
            parts.append(_tube(np.array([(0.27 * x, 0.26 * y, 0), (0.2 * x, 0.19 * y, 0.46)]), 0.024))
        parts.append(_tube(np.array([(0.243 * x, -0.234 * x * x, 0.17), (0.243 * x, 0.234, 0.17)]), 0.015))
        parts.append(_tube(np.array([(0.21 * x, 0.21, 0.47), (0.23 * x, 0.3, 1.02)]), 0.024))
    parts.append(_tube(np.array([(-0.235, 0, 0.17), (0.235, 0, 0.17)]), 0.015))
    for height, depth in ((0.64, 0.24), (0.78, 0.263), (0.92, 0.286)):
        parts.append(_box((0, depth, height), (0.215, 0.012, 0.04)))
    parts.append(_box((0, 0.302, 1.03), (0.26, 0.02, 0.05)))
    return join(*parts)


def knot_on_plinth() -> Mesh:
    """Trefoil knot that stands on its edge on a square plinth."""
    t = np.linspace(0, 2 * np.pi, 400)
    knot = np.stack([np.sin(t) + 2 * np.sin(2 * t), -np.sin(3 * t) * 1.1, np.cos(t) - 2 * np.cos(2 * t)], axis=-1)
    tube = _tube(knot * 0.3, 0.19, closed=True)
    bottom = tube[0][:, 2].min()
    base = _box((0, 0, bottom - 0.1), (0.62, 0.45, 0.13))
    return join(tube, base, _box((0, 0, bottom - 0.3), (0.75, 0.58, 0.09)))


def join(*parts: Mesh) -> Mesh:
    """One mesh of several."""
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    faces = [part[1] + offset for part, offset in zip(parts, offsets, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def _grid(points: np.ndarray) -> Mesh:
    """Mesh of a grid of points (R, C, 3)."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return points.reshape(-1, 3), np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])


def _tube(line: np.ndarray, radius: float, closed: bool = False, sides: int = 32) -> Mesh:
    """Tube about a line (L, 3)."""
    tangent = np.gradient(line, axis=0)
    if closed:  # the last point is the first again
        tangent[0] = tangent[-1] = line[1] - line[-2]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.cross(tangent, (0.0, 1.0, 0.0) if np.abs(tangent[:, 1]).max() < 0.95 else (0.36, 0.48, 0.8))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    around = np.linspace(0, 2 * np.pi, sides + 1)[:, None, None]
    ring = line + radius * (np.cos(around) * across + np.sin(around) * np.cross(tangent, across))
    return _grid(ring)


def _box(centre: tuple[float, float, float], half: tuple[float, float, float]) -> Mesh:
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return corners * half + centre, np.array(faces, dtype=np.int64)


def _spline(knots: np.ndarray, count: int) -> np.ndarray:
    """Catmull-Rom curve (count, D) through knots (K, D)."""
    padded = np.concatenate([2 * knots[:1] - knots[1:2], knots, 2 * knots[-1:] - knots[-2:-1]])
    position = np.linspace(0, len(knots) - 1, count)
    segment = np.minimum(position.astype(int), len(knots) - 2)
    t = (position - segment)[:, None]
    p0, p1, p2, p3 = (padded[segment + shift] for shift in range(4))
    return 0.5 * (2 * p1 + (p2 - p0) * t + (2 * p0 - 5 * p1 + 4 * p2 - p3) * t**2 + (3 * p1 - p0 - 3 * p2 + p3) * t**3)
