"""Synthetic shapes that probe limits: bumps of rising frequency, parallel plates, thin sheets, many objects.

Each lies in the unit sphere without being scaled to it, so that the compared parts stay in place.
"""

from __future__ import annotations

import numpy as np

from z2p_core.camera import turn
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_renderer.pipeline.shapes import shape
from z2p_renderer.storage.meshes import Mesh

TURN = 2 * np.pi
BALL_RADIUS = 0.85
"""Radius of the bumpy ball, world units."""
BUMP_SLOPE = 0.5
"""Relative amplitude of the bumps times their degree, so that steepness is constant, not height."""
BALL_CELLS = (480, 240)
"""Grid cells along longitude and latitude."""
PLATE_SIZE = (0.05, 1.0, 0.8)
"""Thickness, depth and height of a plate, world units."""
SHEET_CELLS = 60
"""Grid cells along a side of the sheet."""
SCENE_SHAPES = ("torus_knot", "rounded_block", "vase", "gear", "bumpy_ball", "seashell", "klein_bottle")


def harmonic_ball(degree: float) -> Mesh:
    """A ball with bumps: the real spherical harmonic of `degree` and order degree / 2; a plain ball for degree 0."""
    u, v = np.meshgrid(*(np.linspace(0, 1, cells + 1) for cells in BALL_CELLS), indexing="ij")
    longitude, polar = TURN * u, np.pi * v
    wave = np.zeros_like(u)
    if degree:
        wave = BUMP_SLOPE / degree * _spherical_harmonic(int(degree), longitude, polar)
    radius = BALL_RADIUS * (1 + wave) / (1 + BUMP_SLOPE / 4)
    positions = np.stack([radius * np.sin(polar) * np.cos(longitude), radius * np.sin(polar) * np.sin(longitude),
                       radius * np.cos(polar)], axis=-1)  # fmt: skip
    return Mesh(*_grid_mesh(positions), smooth=True)


def parallel_plates(distance: float, solid: bool = False) -> Mesh:
    """Two upright plates `distance` apart, seen edge-on; `solid` fills the gap between them."""
    thickness, depth, height = PLATE_SIZE
    outer = distance / 2 + thickness
    if solid:
        return _box_mesh([((0, 0, 0), (outer, depth / 2, height / 2))])
    middle = (distance + thickness) / 2
    return _box_mesh([((side * middle, 0, 0), (thickness / 2, depth / 2, height / 2)) for side in (-1, 1)])


def tilted_sheet(thickness: float) -> Mesh:
    """A wavy sheet of that thickness, tilted towards the camera; with thickness 0 it is a single open layer."""
    u, v = np.meshgrid(*[np.linspace(-1, 1, SHEET_CELLS + 1)] * 2, indexing="ij")
    height = 0.18 * np.sin(5 * u + 1) * np.cos(4 * v)
    layers = []
    for side in (1, -1) if thickness else (1,):
        positions = 0.62 * np.stack([u, v, height], axis=-1)
        positions[..., 2] += side * thickness / 2
        layers.append(_grid_mesh(positions if side > 0 else positions[::-1]))
    vertices, faces = (np.concatenate(parts) for parts in zip(*_offset_faces(layers), strict=True))
    if thickness:
        faces = np.concatenate([faces, _join_rims(vertices, faces)])
    tilt = np.array([[1, 0, 0], [0, 0.64, -0.77], [0, 0.77, 0.64]])
    return Mesh(vertices @ tilt.T, faces, smooth=True)


def objects_on_floor(count: float) -> Mesh:
    """`count` objects side by side on one floor, scaled to the unit sphere."""
    side = int(np.ceil(np.sqrt(count)))
    parts = []
    for index in range(int(count)):
        vertices, faces = shape(SCENE_SHAPES[index % len(SCENE_SHAPES)])
        placed = bounding_sphere(vertices).normalise(vertices).astype(np.float64) @ turn(40.0 * index).T
        placed[:, 2] -= placed[:, 2].min()
        floor_position = (np.array([index % side, index // side, 0.0]) - (side - 1) / 2 * np.array([1, 1, 0])) * 2.1
        parts.append((placed + floor_position, faces))
    vertices, faces = (np.concatenate(joined) for joined in zip(*_offset_faces(parts), strict=True))
    return Mesh(bounding_sphere(vertices).normalise(vertices).astype(np.float64), faces, smooth=True)


def _spherical_harmonic(degree: int, longitude: np.ndarray, polar: np.ndarray) -> np.ndarray:
    """Real spherical harmonic of `degree` and order degree / 2, scaled to [-1, 1]."""
    order, cosine = max(degree // 2, 1), np.cos(polar)
    before, now = np.zeros_like(cosine), np.sin(polar) ** order
    for step in range(order, degree):  # (n - m + 1) P(n+1) = (2n + 1) x P(n) - (n + m) P(n-1)
        before, now = now, ((2 * step + 1) * cosine * now - (step + order) * before) / (step - order + 1)
    wave = now * np.cos(order * longitude)
    scaled: np.ndarray = wave / np.abs(wave).max()
    return scaled


def _grid_mesh(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and triangles (M, 3) of a grid of positions (A, B, 3), with coincident vertices merged."""
    columns, rows = positions.shape[0] - 1, positions.shape[1] - 1
    corner = (np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)).ravel()
    quads = np.stack([corner, corner + rows + 1, corner + rows + 2, corner + 1], axis=1)
    faces = np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    vertices, which = np.unique(np.round(positions.reshape(-1, 3), 7) + 0.0, axis=0, return_inverse=True)
    a, b, c = which.reshape(-1)[faces].T
    return vertices, np.stack([a, b, c], axis=1)[(a != b) & (b != c) & (c != a)]


def _join_rims(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Triangles (M, 3) that join the open edges of two equal layers, whose vertices follow one another."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    keys = np.sort(edges, axis=1) @ (len(vertices), 1)
    single = edges[np.isin(keys, [key for key, times in zip(*np.unique(keys, return_counts=True), strict=True)
                                  if times == 1])]  # fmt: skip
    half = len(vertices) // 2
    upper = single[(single < half).all(axis=1)]
    across = {tuple(np.round(place[:2], 6)): half + index for index, place in enumerate(vertices[half:])}
    below = np.array([[across[tuple(np.round(vertices[end][:2], 6))] for end in edge] for edge in upper])
    first = np.stack([upper[:, 1], upper[:, 0], below[:, 0]], axis=1)
    return np.concatenate([first, np.stack([upper[:, 1], below[:, 0], below[:, 1]], axis=1)])


def _box_mesh(boxes: list[tuple[tuple[float, float, float], tuple[float, float, float]]]) -> Mesh:
    """Boxes of given (centre, half sides), flat-shaded."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([(q[0], q[i], q[i + 1]) for q in quads for i in (1, 2)])
    parts = [(np.array(centre) + corners * np.array(half), triangles) for centre, half in boxes]
    vertices, faces = (np.concatenate(joined) for joined in zip(*_offset_faces(parts), strict=True))
    return Mesh(vertices, faces, smooth=False)


def _offset_faces(parts: list[tuple[np.ndarray, np.ndarray]]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The (vertices, faces) parts with faces that index the concatenation of all vertices."""
    offset_parts, first = [], 0
    for vertices, faces in parts:
        offset_parts.append((vertices, faces + first))
        first += len(vertices)
    return offset_parts
