"""What surfaces mirror of lamps: energy, places of highlights, images, and what a matt surface sends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from z2p_core import native
from z2p_core.scene import LIGHT_RADIANCE
from z2p_core.shading.area_light import area_light_samples, area_light_quad
from z2p_core.shading.microfacet import TABLE_COSINES, directional_albedo_table

INDEX = 1.5
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
    """What an upright surface sends under a sky of radiance 1, made of far lamps: (4,), that of a matt one last."""
    far, point = 100.0, np.zeros((1, 3))
    lamps = [native.specular_radiance(point, UP[None], towards, far * way[None], -way, far**2 * 2 * math.pi / count, alpha, INDEX)
             for way in hemisphere(count)]  # fmt: skip
    total: np.ndarray = np.sum([np.append(shine, matt) for shine, matt in lamps], axis=0)
    return total


@pytest.mark.parametrize("alpha", [0.3, 0.6, 1.0])
def test_rough_surfaces_never_send_more_than_they_get(alpha: float) -> None:
    """As a single reflection of GGX does; and another way of adding up the same, by directions, comes to the same."""
    shares = directional_albedo_table(math.sqrt(alpha), INDEX)
    for degrees in (0, 30, 60, 75):
        mirrored, metal, plastic, matt = under_white_sky(slanted(degrees), alpha)
        assert 0.25 < mirrored < 1.01
        assert 0 < metal < mirrored and 0 < plastic < mirrored
        assert matt == pytest.approx(1, abs=0.01)
        added = [np.interp(math.cos(math.radians(degrees)), TABLE_COSINES, share) for share in shares.T]
        assert added == pytest.approx([mirrored - metal, metal, mirrored - plastic, plastic], abs=0.025)


def test_what_is_known_of_the_smooth_and_the_roughest_is_met() -> None:
    assert under_white_sky(slanted(20), 0.15, 20_000)[0] == pytest.approx(1, abs=0.05)
    assert under_white_sky(slanted(0), 1.0)[0] == pytest.approx(1 - math.log(2), abs=0.002), "the integral, by hand"


def test_the_lamp_is_brightest_where_a_mirror_shows_it() -> None:
    angles = np.arange(-60, 61)
    towards = np.concatenate([slanted(angle) for angle in angles])
    normals, points = np.tile(UP, (len(angles), 1)), np.zeros((len(angles), 3))
    lamp = 3 * slanted(-25)
    for alpha in (0.04, 0.2):
        mirrored = native.specular_radiance(points, normals, towards, lamp, -slanted(-25)[0], 1.0, alpha, INDEX)[0][:, 0]
        assert angles[mirrored.argmax()] == pytest.approx(25, abs=2)
    half = np.ptp(angles[mirrored > mirrored.max() / 2])
    narrow = native.specular_radiance(points, normals, towards, lamp, -slanted(-25)[0], 1.0, 0.1, INDEX)[0][:, 0]
    assert np.ptp(angles[narrow > narrow.max() / 2]) < 0.7 * half


def test_a_matt_surface_gets_what_lamps_give() -> None:
    """Power x cosine x cosine / distance^2, over pi; nothing from behind it or behind the lamp."""
    lamp, axis = np.array([[1.0, 0.0, 2.0]]), np.array([0.0, 0.0, -1.0])
    point, towards = np.zeros((1, 3)), slanted(10)
    given = 5.0 * (2 / math.sqrt(5)) ** 2 / 5 / math.pi
    assert native.specular_radiance(point, UP[None], towards, lamp, axis, 5.0, 0.3, INDEX)[1][0] == pytest.approx(given, rel=1e-5)
    for dark in ((-UP[None], -towards, lamp, axis), (UP[None], towards, lamp, -axis)):
        shine, matt = native.specular_radiance(point, *dark, 5.0, 0.3, INDEX)
        assert (shine == 0).all() and (matt == 0).all()


def images(mirrors: np.ndarray, blur: float, light: np.ndarray) -> np.ndarray:
    """What a mirror in the origin shows of a light to viewers above, whom it mirrors to unit directions (M, 3)."""
    normals, towards = mirrors + UP, np.tile(UP, (len(mirrors), 1))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return native.sharp_light_reflection(np.zeros_like(mirrors), normals, towards, light, 7.0, blur, INDEX)


def test_a_mirror_shows_the_lights_square_and_nothing_else() -> None:
    """A ray meets the square or it does not, whichever its place on it; by brute force."""
    light, rng = area_light_quad((3.6, -40.0, 50.0)), np.random.default_rng(0)
    places = light[0] + rng.uniform(-1, 1, (4000, 2)) @ light[1:]
    inside = (np.abs((places - light[0]) @ light[1:].T) < 0.5 * (light[1:] ** 2).sum(1)).all(1)
    ways = places / np.linalg.norm(places, axis=1, keepdims=True)
    seen = images(ways, 1e-4, light)[:, 0]
    assert (np.isclose(seen, 7.0) | np.isclose(seen, 0, atol=1e-3)).mean() > 0.99
    assert ((seen > 3.5) == inside).mean() > 0.995
    assert (images(-ways, 1e-4, light) == 0).all(), "behind the mirror's back"
    outwards = light * [[1.0], [1.0], [-1.0]]  # the sides in the other order
    np.testing.assert_allclose(images(ways, 0.05, outwards), images(ways, 0.05, light), atol=1e-5)


def test_blur_moves_the_edges_but_takes_no_light_away() -> None:
    light = area_light_quad((3.6, -40.0, 50.0))
    steps = np.linspace(-1, 1, 401)
    places = light[0] + steps[:, None] * light[1]
    ways = places / np.linalg.norm(places, axis=1, keepdims=True)
    sharp, soft = images(ways, 1e-4, light)[:, 0], images(ways, 0.04, light)[:, 0]
    assert soft.sum() == pytest.approx(sharp.sum(), rel=0.03)
    assert ((soft > 0.1) & (soft < 6.9)).sum() > 30 > ((sharp > 0.1) & (sharp < 6.9)).sum()
    assert np.abs(steps[np.abs(soft - 3.5).argsort()[:2]]) == pytest.approx(0.5, abs=0.02)


def test_the_image_and_the_lobe_of_a_smooth_surface_are_as_bright() -> None:
    """Summed over all ways to look at it, either is what the light sends."""
    lit = (3.6, -40.0, 50.0)
    light, (places, axes, powers) = area_light_quad(lit), area_light_samples(lit, 36)
    rng = np.random.default_rng(1)
    normals = light[0] / np.linalg.norm(light[0]) + UP + rng.uniform(-0.5, 0.5, (60_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    seen = (np.zeros_like(normals), normals, np.tile(UP, (len(normals), 1)))
    lobe = native.specular_radiance(*seen, places, axes[0], float(powers[0]), 0.04, INDEX)[0].mean(0)
    image = native.sharp_light_reflection(*seen, light, LIGHT_RADIANCE, 1.7 * 0.04, INDEX).mean(0)
    assert image[0] == pytest.approx(lobe[0], rel=0.06)


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 3000])
def test_each_point_is_by_itself(count: int) -> None:
    rng = np.random.default_rng(count)
    points, normals, towards = rng.normal(size=(3, count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    lamps = (rng.normal(size=(7, 3)) + 4, np.array([0.0, 0.0, -1.0]), 2.0, 0.2, INDEX)
    square = (area_light_quad((3.6, -40.0, 50.0)), 5.0, 0.03, INDEX)
    shine, matt = native.specular_radiance(points, normals, towards, *lamps)
    shown = native.sharp_light_reflection(points, normals, towards, *square)
    assert matt.shape == (count,) and (matt >= 0).all()
    for found in (shine, shown):
        assert found.shape == (count, 3) and np.isfinite(found).all() and (found >= -1e-6).all()
    for row in rng.integers(0, max(count, 1), 5 if count else 0):
        one = slice(row, row + 1)
        seen = (points[one], normals[one], towards[one])
        np.testing.assert_array_equal(native.specular_radiance(*seen, *lamps)[0][0], shine[row])
        np.testing.assert_array_equal(native.sharp_light_reflection(*seen, *square)[0], shown[row])
