"""The hull of a thing's feet, its area, and how far inside it the middle lies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from z2p_core.up_axis.support_polygon import convex_hull, distance_inside, polygon_area

RNG = np.random.default_rng(0)


def test_support_margin_is_the_signed_distance_to_the_hull() -> None:
    square = np.array([[0.0, 0], [2, 0], [2, 1], [0, 1]])
    for place, expected in (([1.0, 0.5], 0.5), ([1.0, 0.9], 0.1), ([1.0, 1.0], 0.0), ([3.0, 0.5], -1.0)):
        assert distance_inside(np.array(place), square) == pytest.approx(expected)


def test_hulls() -> None:
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    inside = RNG.uniform(0.01, 0.99, (200, 2))
    found = convex_hull(np.vstack([inside, square, square]))
    assert {tuple(corner) for corner in found} == {tuple(corner) for corner in square}
    assert polygon_area(found) == pytest.approx(1)
    assert polygon_area(convex_hull(np.array([[0.0, 0], [1, 1], [2, 2]]))) == 0


def exact_hull(points: np.ndarray) -> np.ndarray:
    """Andrew's monotone chain."""
    ordered = sorted(map(tuple, points.tolist()))

    def chain(row: list[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for x, y in row:
            while len(kept) > 1:
                (ax, ay), (bx, by) = kept[-2:]
                if (bx - ax) * (y - by) - (by - ay) * (x - bx) > 0:
                    break
                kept.pop()
            kept.append((x, y))
        return kept

    return np.array(chain(ordered)[:-1] + chain(ordered[::-1])[:-1]).reshape(-1, 2)


@given(st.integers(3, 600), st.integers(0, 50), st.sampled_from(["ball", "disc", "square", "line", "grid", "far"]))
def test_the_hull_is_nearly_exact_with_points_as_corners(count: int, seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 2))
    if kind == "square":
        points = rng.uniform(-1, 1, (count, 2))
    elif kind == "disc":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    elif kind == "line":
        points[:, 1] = 2 * points[:, 0]
    elif kind == "grid":
        points = rng.integers(0, 9, (count, 2)).astype(float)
    elif kind == "far":
        points = points * 1e-3 + 5e6
    found, area = convex_hull(points), polygon_area(exact_hull(points) - points[0])
    assert {tuple(corner) for corner in found} <= {tuple(point) for point in points}
    assert 0.98 * area - 1e-9 <= polygon_area(found - points[0]) <= area * (1 + 1e-6) + 1e-9
