"""Parts that meshes are built of: plates, boxes, what a profile sweeps about an axis, bars along curves.

Corners of different sides are different vertices, so that edges stay sharp where normals are joined; within a patch
they are one, so that it stays smooth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

Part = tuple[np.ndarray, np.ndarray]
"""Vertices (V, 3) and triangles (M, 3)."""
Place = Sequence[float]
"""x, y, z."""
TURN = 2 * math.pi


def joined(parts: list[Part]) -> Part:
    """All parts as one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [faces + start for (_, faces), start in zip(parts, starts, strict=False)]
    return np.vstack([vertices for vertices, _ in parts]), np.vstack(faces)


def moved(part: Part, by: Place) -> Part:
    """The part, moved."""
    return np.add(part[0], by), part[1]


def patch(places: np.ndarray) -> Part:
    """A smooth patch through a grid of places (R, C, 3)."""
    rows, columns = places.shape[:2]
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    quads = np.stack([corner, corner + columns, corner + columns + 1, corner + 1], axis=1)
    return places.reshape(-1, 3), np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def block(low: np.ndarray, high: np.ndarray) -> list[Part]:
    """Six sides between two quadrilaterals (2, 2, 3), the places of their corners."""
    sides = [low, high]
    for a, b in (((0, 0), (0, 1)), ((0, 1), (1, 1)), ((1, 1), (1, 0)), ((1, 0), (0, 0))):
        sides.append(np.array([[low[a], low[b]], [high[a], high[b]]]))
    return [patch(side) for side in sides]


def box(size: Place, at: Place, turn: float = 0.0, tilt: float = 0.0) -> list[Part]:
    """A box of that size about a place, tilted about x, then turned about z, radians."""
    x, y = np.meshgrid([-0.5, 0.5], [-0.5, 0.5], indexing="ij")
    ends = [np.stack([x, y, np.full((2, 2), z)], axis=-1) * size @ rotation(turn, tilt).T + at for z in (-0.5, 0.5)]
    return block(*ends)


def rotation(turn: float, tilt: float) -> np.ndarray:
    """The rotation (3, 3) about x, then about z."""
    (a, b), (c, d) = (math.cos(turn), math.sin(turn)), (math.cos(tilt), math.sin(tilt))
    around: np.ndarray = np.array([[a, -b, 0], [b, a, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -d], [0, d, c]])
    return around


def lathe(profile: Sequence[tuple[float, float]], at: Place = (0, 0, 0), around: int = 48) -> list[Part]:
    """What a profile of radii and heights sweeps about z, sharp at the profile's corners."""
    angle = np.linspace(0, TURN, around + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    parts = []
    for first, second in pairwise(profile):
        rings = [np.column_stack([radius * circle, np.full(len(angle), height)]) for radius, height in (first, second)]
        parts.append(patch(np.stack(rings) + at))
    return parts


def turned_smooth(radii: np.ndarray, heights: np.ndarray, around: int = 48) -> Part:
    """What a smooth profile (P,), (P,) sweeps about z."""
    angle = np.linspace(0, TURN, around + 1)
    x, y = radii[:, None] * np.cos(angle), radii[:, None] * np.sin(angle)
    return patch(np.stack([x, y, np.broadcast_to(heights[:, None], x.shape)], axis=-1))


def tube(path: np.ndarray, radius: float | np.ndarray, around: int = 16) -> list[Part]:
    """A round bar along a path (P, 3), its ends closed; the radius is one, or (P,)."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    least = np.eye(3)[np.abs(along).mean(0).argmin()]
    side = np.empty_like(path)
    for row, direction in enumerate(along):  # each ring turned as little as can be against the one before
        least = least - direction * (least @ direction)
        least = side[row] = least / np.linalg.norm(least)
    other = np.cross(along, side)
    angle = np.linspace(0, TURN, around + 1)
    radii = np.broadcast_to(radius, len(path))[:, None, None]
    rings = path[:, None] + radii * (np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * other[:, None])
    caps = [patch(np.stack([rings[end], np.broadcast_to(path[end], rings[end].shape)])) for end in (0, -1)]
    return [patch(rings), *caps]


def bar(start: Place, end: Place, radius: float, around: int = 16) -> list[Part]:
    """A straight round bar."""
    return tube(np.linspace(start, end, 2), radius, around)


def curve(places: Sequence[Place], count: int = 40) -> np.ndarray:
    """A smooth path (count, 3) near places, its ends at theirs: Bezier's."""
    t, degree = np.linspace(0, 1, count)[:, None], len(places) - 1
    path: np.ndarray = sum(
        math.comb(degree, i) * t**i * (1 - t) ** (degree - i) * np.asarray(place, dtype=float)
        for i, place in enumerate(places)
    )
    return path
