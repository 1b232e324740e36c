"""Subdivision keeps the surface, its orientation and what is linear on it, and makes no edge longer than asked for."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.meshes import subdivision
from z2p_core.meshes.subdivision import subdivide, subdivision_steps

TRIANGLES = np.random.default_rng(0).normal(size=(20, 3, 3))


def longest_edges(corners: np.ndarray) -> np.ndarray:
    edges: np.ndarray = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return edges


def area_vectors(corners: np.ndarray) -> np.ndarray:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2


def test_no_edge_is_longer_than_asked_for() -> None:
    steps = subdivision_steps(TRIANGLES, 0.2)
    finer = subdivide(TRIANGLES, steps)
    assert len(finer) == (steps**2).sum() and longest_edges(finer).max() <= 0.2 * (1 + 1e-9)


def test_parts_have_the_area_and_the_orientation_of_the_whole() -> None:
    for steps in (1, 2, 3, 7):
        parts = subdivide(TRIANGLES[:1], np.array([steps]))
        whole = area_vectors(TRIANGLES[:1])[0]
        np.testing.assert_allclose(area_vectors(parts), np.tile(whole / steps**2, (steps**2, 1)), atol=1e-12)


def test_linear_values_stay_linear() -> None:
    plane = np.array([0.3, -0.2, 0.9])
    finer = subdivide(np.dstack([TRIANGLES, TRIANGLES @ plane]), np.full(20, 5))
    np.testing.assert_allclose(finer[..., 3], finer[..., :3] @ plane, atol=1e-12)


def test_parts_meet_without_gaps() -> None:
    corners = subdivide(TRIANGLES[:1], np.array([6])).reshape(-1, 3)
    places, count = np.unique(corners.round(9), axis=0, return_counts=True)
    assert len(places) == 28 and sorted(count)[:3] == [1, 1, 1] and count.max() == 6


def test_too_many_triangles_stay_larger(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subdivision, "MAX_TRIANGLES", 500)
    steps = subdivision_steps(TRIANGLES, 0.01)
    assert (steps**2).sum() <= 500 and steps.max() > 1


def test_no_triangles_give_none() -> None:
    assert subdivide(TRIANGLES[:0], np.zeros(0, np.int64)).shape == (0, 3, 3)
