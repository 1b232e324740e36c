"""Checks of `Sampler` plugins."""

from __future__ import annotations

import numpy as np

from z2p_core.contracts.assertions import check_array, check_class, expect, same
from z2p_core.interfaces import Sampler

BOX = np.array([1.0, 0.6, 0.35])
"""Half sides of the box that samplers are tried on."""


def check_sampler(sampler_class: type[Sampler]) -> None:
    """None when the class keeps what `Sampler` promises: exactly that many points, on the surface, from the rng alone.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("samplers", sampler_class, Sampler)
    sampler, name = sampler_class(), sampler_class.name
    vertices, faces = _box(BOX)
    given = vertices.copy(), faces.copy()
    for count in (10, 257, 600):
        points = sampler.sample(vertices, faces, count, np.random.default_rng(count))
        check_array(points, (count, 3), np.float64, f"{name}: {count} points asked for, sample")
        off = np.abs((np.abs(points) / BOX).max(1) - 1).max()
        expect(off < 1e-5, f"{name}: a point lies {off:.2g} of the box's half side off the surface")
        again = sampler.sample(vertices, faces, count, np.random.default_rng(count))
        same(again, points, f"{name}: the same rng, sample")
    same(vertices, given[0], f"{name}: the vertices given to sample")
    same(faces, given[1], f"{name}: the faces given to sample")
    sides = {(axis, sign) for axis in range(3) for sign in (-1, 1) if (sign * points[:, axis] > BOX[axis] - 1e-4).any()}
    expect(len(sides) == 6, f"{name}: {count} points on a box leave {6 - len(sides)} of its sides empty")


def _box(half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (8, 3) float64 and triangles (12, 3) int64 of a box about the origin."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return corners * half, np.array(faces, dtype=np.int64)
