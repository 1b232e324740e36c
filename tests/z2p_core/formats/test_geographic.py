"""Degrees beside metres are distinguished from tall, thin objects and from metres in the range of degrees."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.formats.geographic import metres_from_degrees

RNG = np.random.default_rng(0)


def ground(wide: float, high: float, at: tuple[float, float]) -> np.ndarray:
    """Hills over a square of so many degrees."""
    x, y = RNG.random((2, 2000))
    return np.column_stack([at[0] + wide * x, at[1] + wide * y, 200 + high * np.sin(3 * x) * np.cos(2 * y)])


@pytest.mark.parametrize("wide", [0.002, 0.05, 0.9])
@pytest.mark.parametrize("at", [(7.1, 50.2), (-122.4, 37.7), (151.2, -33.9), (50.2, 7.1), (-0.1, 51.5)])
def test_ground_in_degrees_is_laid_out_in_metres(wide: float, at: tuple[float, float]) -> None:
    points = ground(wide, 60, at)
    metres, note = metres_from_degrees(points)
    assert "look like degrees" in note and "pyproj" in note
    east, north = np.ptp(metres, axis=0)[:2]
    assert north == pytest.approx(wide * 111_320, rel=0.02)
    assert east / north == pytest.approx(np.cos(np.radians(at[1])), rel=0.02)
    assert np.array_equal(metres[:, 2], points[:, 2])


def pole(radius: float, high: float, at: tuple[float, float]) -> np.ndarray:
    turn = RNG.random(2000) * 2 * np.pi
    return np.column_stack([at[0] + radius * np.cos(turn), at[1] + radius * np.sin(turn), high * RNG.random(2000)])


@pytest.mark.parametrize(
    "points",
    [pole(0.1, 8, (7.1, 50.2)), pole(0.1, 8, (0, 0)), pole(0.05, 20, (12.3, -4.4)), pole(1, 200, (40, 60)),
     ground(1, 1, (7.1, 50.2)), ground(0.5, 5, (7.1, 50.2)), ground(100, 5000, (1000, 2000)), ground(1, 60, (0, 0)),
     np.add(RNG.random((2000, 3)), (7.1, 50.2, 0)), ground(0.9, 60, (-0.4, 0.3)), pole(0.1, 8, (7.1, 50.2)).round(0)],
    ids=str,
)  # fmt: skip
def test_points_other_than_ground_in_degrees_stay(points: np.ndarray) -> None:
    same, note = metres_from_degrees(points)
    assert same is points and (not note or note.startswith("if x and y"))


def test_uncertain_degrees_get_a_note() -> None:
    assert metres_from_degrees(pole(0.1, 8, (7.1, 50.2)))[1].startswith("if x and y (7..7.2, 50.1..50.3) are degrees")
