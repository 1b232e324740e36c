"""What stands firmly one way and topples over the other is found; all else is left as it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from z2p_core.camera import turn
from z2p_core.framing import choose_up
from z2p_core.standing import area_of, hull, stance, topples

RNG = np.random.default_rng(0)
X, Y, Z = np.eye(3)
TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def box(count: int, *half: float) -> np.ndarray:
    sides = np.array(half)
    area = np.prod(sides) / sides
    axis = RNG.choice(3, size=count, p=area / area.sum())
    points = RNG.uniform(-1, 1, (count, 3))
    points[np.arange(count), axis] = RNG.choice([-1, 1], size=count)
    return points * sides


def ball(count: int, *half: float) -> np.ndarray:
    points = RNG.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * half


def rabbit() -> np.ndarray:
    """A sitting body, cut flat below, with a head to the front; +Z up."""
    body, head = ball(4000, 0.5, 0.7, 0.6), ball(1500, 0.25, 0.3, 0.3) + np.array([0, -0.7, 0.6])
    points = np.vstack([body, head])
    points[:, 2] = np.maximum(points[:, 2], -0.4)
    return points


def beast() -> np.ndarray:
    """A round body on four legs, with a neck; +Z up."""
    legs = [box(300, 0.06, 0.06, 0.35) + np.array([x, y, -0.6]) for x in (-0.25, 0.25) for y in (-0.5, 0.5)]
    return np.vstack([ball(3000, 0.3, 0.75, 0.35), ball(700, 0.15, 0.35, 0.15) + np.array([0, -0.8, 0.45]), *legs])


def lamp() -> np.ndarray:
    pole = np.column_stack([RNG.normal(0, 0.02, (1500, 2)), RNG.uniform(0, 6, 1500)])
    return np.vstack([pole, np.column_stack([RNG.uniform(-1.4, 0, 300), np.zeros(300), np.full(300, 6.0)])])


def hill() -> np.ndarray:
    x, y = RNG.uniform(-1, 1, (2, 6000))
    return np.column_stack([x, y, 0.3 * x + 0.1 * np.sin(5 * y)])


@pytest.mark.parametrize("thing", [rabbit(), beast()], ids=["rabbit", "beast"])
def test_a_thing_that_stands_is_stood_up_whatever_the_format_holds_usual(thing: np.ndarray) -> None:
    for azimuth in (0.0, 35.0, 90.0, 160.0, 180.0):
        upright = thing @ turn(azimuth).T
        assert choose_up(upright, None, ".ply").axis == "+Z"  # right already, never turned away
        assert choose_up(upright @ TO_Y_UP.T, None, ".obj").axis == "+Y"
    assert choose_up(thing @ turn(160.0).T @ TO_Y_UP.T, None, ".ply").axis == "+Y"
    assert choose_up(thing @ turn(-20.0).T, None, ".obj").axis == "+Z"
    told = choose_up(thing @ turn(160.0).T @ TO_Y_UP.T, None, ".ply").reason
    assert told == "it stands firmly so, and would topple over with +Z up"


@pytest.mark.parametrize("suffix", [".pcd", ".las", ".e57", ".xyz", ".glb", ""])
def test_scanners_formats_keep_their_convention(suffix: str) -> None:
    usual = "+Y" if suffix == ".glb" else "+Z"
    for thing in (rabbit(), rabbit() @ TO_Y_UP.T):
        assert choose_up(thing, None, suffix).axis == usual


@pytest.mark.parametrize(
    "thing", [box(4000, 1, 1, 1), box(4000, 1, 0.5, 0.3), ball(4000, 1, 1, 1), lamp(), hill(), rabbit()[::20]],
    ids=["cube", "brick", "ball", "lamp", "hill", "few points"],
)  # fmt: skip
def test_without_strong_evidence_nothing_is_turned(thing: np.ndarray) -> None:
    for turned in (thing, thing @ TO_Y_UP.T):
        assert not topples(turned, Z, Y)
        assert not topples(turned, Y, Z)


def test_a_box_stands_on_its_whole_footprint_and_a_ball_on_a_point() -> None:
    margin, area = stance(box(6000, 1, 1, 0.5), Z)
    assert area == pytest.approx(1, abs=0.02) and margin == pytest.approx(0.5, abs=0.03)
    margin, area = stance(ball(6000, 1, 1, 1), Z)
    assert area < 0.15
    assert stance(np.column_stack([np.linspace(0, 1, 50), np.zeros((50, 2))]), Z) == (-1.0, 0.0)
    leaning = np.vstack([box(3000, 0.2, 0.2, 0.1), box(3000, 1, 0.2, 0.1) + np.array([1.5, 0, 1.0])])
    assert stance(leaning, Z)[0] < -0.2


def test_hulls() -> None:
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    inside = RNG.uniform(0.01, 0.99, (200, 2))
    found = hull(np.vstack([inside, square, square]))
    assert {tuple(corner) for corner in found} == {tuple(corner) for corner in square}
    assert area_of(found) == pytest.approx(1)
    assert area_of(hull(np.array([[0.0, 0], [1, 1], [2, 2]]))) == 0


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
def test_the_hull_is_nearly_the_exact_one_and_its_corners_are_points(count: int, seed: int, kind: str) -> None:
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
    found, area = hull(points), area_of(exact_hull(points) - points[0])
    assert {tuple(corner) for corner in found} <= {tuple(point) for point in points}
    assert 0.99 * area - 1e-9 <= area_of(found - points[0]) <= area * (1 + 1e-6) + 1e-9
