"""What rough surfaces mirror of lamps: energy, places of highlights, and what a matt surface sends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from z2p_core import native

UP = np.array([0.0, 0.0, 1.0])


def slanted(degrees: float) -> np.ndarray:
    """Unit direction (1, 3) so far from straight up."""
    angle = math.radians(degrees)
    return np.array([[math.sin(angle), 0.0, math.cos(angle)]])


def hemisphere(count: int) -> np.ndarray:
    """Unit directions (count, 3) spread evenly above the horizon."""
    height = (np.arange(count) + 0.5) / count
    turn = np.arange(count) * math.pi * (3 - math.sqrt(5))
    side = np.sqrt(1 - height**2)
    return np.column_stack([side * np.cos(turn), side * np.sin(turn), height])


def under_white_sky(towards: np.ndarray, alpha: float, count: int = 4000) -> np.ndarray:
    """What an upright surface sends under a sky of radiance 1, made of far lamps: (3,)."""
    far, point = 100.0, np.zeros((1, 3))
    lamps = [native.gloss(point, UP[None], towards, far * way[None], -way, far**2 * 2 * math.pi / count, alpha)
             for way in hemisphere(count)]  # fmt: skip
    total: np.ndarray = np.sum(lamps, axis=0)[0]
    return total


@pytest.mark.parametrize("alpha", [0.3, 0.6, 1.0])
def test_rough_surfaces_never_send_more_than_they_get(alpha: float) -> None:
    """As a single reflection of GGX does; what the sky's share by Schlick is must be in what is mirrored."""
    for degrees in (0, 30, 60, 75):
        mirrored, grazed, matt = under_white_sky(slanted(degrees), alpha)
        assert 0.25 < mirrored < 1.01
        assert 0 < grazed < mirrored
        assert matt == pytest.approx(1, abs=0.01)


def test_what_is_known_of_the_smooth_and_the_roughest_is_met() -> None:
    assert under_white_sky(slanted(20), 0.15, 20_000)[0] == pytest.approx(1, abs=0.05)
    assert under_white_sky(slanted(0), 1.0)[0] == pytest.approx(1 - math.log(2), abs=0.002), "the integral, by hand"


def test_the_lamp_is_brightest_where_a_mirror_shows_it() -> None:
    angles = np.arange(-60, 61)
    towards = np.concatenate([slanted(angle) for angle in angles])
    normals, points = np.tile(UP, (len(angles), 1)), np.zeros((len(angles), 3))
    lamp = 3 * slanted(-25)
    for alpha in (0.04, 0.2):
        mirrored = native.gloss(points, normals, towards, lamp, -slanted(-25)[0], 1.0, alpha)[:, 0]
        assert angles[mirrored.argmax()] == pytest.approx(25, abs=2)
    half = np.ptp(angles[mirrored > mirrored.max() / 2])
    narrow = native.gloss(points, normals, towards, lamp, -slanted(-25)[0], 1.0, 0.1)[:, 0]
    assert np.ptp(angles[narrow > narrow.max() / 2]) < 0.7 * half


def test_a_matt_surface_gets_what_lamps_give() -> None:
    """Power x cosine x cosine / distance^2, over pi; nothing from behind it or behind the lamp."""
    lamp, axis = np.array([[1.0, 0.0, 2.0]]), np.array([0.0, 0.0, -1.0])
    point, towards = np.zeros((1, 3)), slanted(10)
    given = 5.0 * (2 / math.sqrt(5)) ** 2 / 5 / math.pi
    assert native.gloss(point, UP[None], towards, lamp, axis, 5.0, 0.3)[0, 2] == pytest.approx(given, rel=1e-5)
    assert (native.gloss(point, -UP[None], -towards, lamp, axis, 5.0, 0.3) == 0).all()
    assert (native.gloss(point, UP[None], towards, lamp, -axis, 5.0, 0.3) == 0).all()


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 3000])
def test_each_point_is_by_itself(count: int) -> None:
    rng = np.random.default_rng(count)
    points, normals, towards = rng.normal(size=(3, count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    rest = (rng.normal(size=(7, 3)) + 4, np.array([0.0, 0.0, -1.0]), 2.0, 0.2)
    shine = native.gloss(points, normals, towards, *rest)
    assert shine.shape == (count, 3) and np.isfinite(shine).all() and (shine >= 0).all()
    for row in rng.integers(0, max(count, 1), 5 if count else 0):
        one = slice(row, row + 1)
        np.testing.assert_array_equal(native.gloss(points[one], normals[one], towards[one], *rest)[0], shine[row])
