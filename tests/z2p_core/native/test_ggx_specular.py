"""Specular reflection in C against a plain numpy reference, for energy, the place of highlights and mirror images."""

from __future__ import annotations

import math

import numpy as np
import pytest

from z2p_core import native
from z2p_core.scene import LIGHT_RADIANCE
from z2p_core.shading.area_light import area_light_quad, area_light_samples
from z2p_core.shading.microfacet import (
    TABLE_COSINES,
    directional_albedo_table,
    fresnel_dielectric,
    normalized_fresnel,
    smith_lambda,
)

IOR = 1.5
UP = np.array([0.0, 0.0, 1.0])
LIGHT = (3.6, -40.0, 50.0)
"""Radius, azimuth and elevation of the area light."""


def direction_at(degrees: float, azimuth: float = 0.0) -> np.ndarray:
    """Unit direction (1, 3) at an angle from straight up, both in degrees."""
    zenith, turn = math.radians(degrees), math.radians(azimuth)
    return np.array([[math.sin(zenith) * math.cos(turn), math.sin(zenith) * math.sin(turn), math.cos(zenith)]])


def hemisphere(count: int) -> np.ndarray:
    """Unit directions (count, 3), evenly distributed above the horizon."""
    height = (np.arange(count) + 0.5) / count
    azimuth = np.arange(count) * math.pi * (3 - math.sqrt(5))
    sine = np.sqrt(1 - height**2)
    return np.column_stack([sine * np.cos(azimuth), sine * np.sin(azimuth), height])


def ggx_distribution(n_dot_h: float, alpha: float) -> float:
    """D of GGX (Walter et al., 2007, equation 33), by its tangent form."""
    tangent_sq = 1 / n_dot_h**2 - 1
    return alpha**2 / (math.pi * n_dot_h**4 * (alpha**2 + tangent_sq) ** 2)


def smith_g2(n_dot_l: float, n_dot_v: float, alpha: float) -> float:
    """Height-correlated masking and shadowing (Heitz, 2014, equation 99)."""
    return float(1 / (1 + smith_lambda(np.array(n_dot_l), alpha) + smith_lambda(np.array(n_dot_v), alpha)))


def schlick(cosine: float) -> float:
    return (1 - cosine) ** 5


def terms_of(view_dir: np.ndarray, light_dir: np.ndarray, alpha: float, distance: float = 2.0) -> np.ndarray:
    """The three GGX terms and the diffuse radiance (4,) of a surface facing up, lit with an irradiance of n_dot_l."""
    light = distance * light_dir
    specular, diffuse = native.specular_radiance(
        np.zeros((1, 3)), UP[None], view_dir, light, -light_dir[0], distance**2, alpha, IOR
    )
    return np.append(specular[0], diffuse)


@pytest.mark.parametrize("alpha", [0.05, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("view", [0, 20, 50, 80])
def test_terms_are_d_g_f_over_four_cosines(alpha: float, view: int) -> None:
    view_dir, n_dot_v = direction_at(view), math.cos(math.radians(view))
    for light_angle in (0, 25, 60, 85):
        for azimuth in (0, 70, 180):
            light_dir, n_dot_l = direction_at(light_angle, azimuth), math.cos(math.radians(light_angle))
            half = (view_dir + light_dir)[0] / np.linalg.norm(view_dir + light_dir)
            v_dot_h = float(view_dir[0] @ half)
            brdf = ggx_distribution(half[2], alpha) * smith_g2(n_dot_l, n_dot_v, alpha) / (4 * n_dot_l * n_dot_v)
            fresnel = float(normalized_fresnel(np.array(v_dot_h), IOR))
            weights = np.array([1, schlick(v_dot_h), fresnel])
            expected = np.append(brdf * n_dot_l * weights, n_dot_l / math.pi)
            np.testing.assert_allclose(terms_of(view_dir, light_dir, alpha), expected, rtol=2e-3, atol=1e-6)


def test_mirror_image_has_the_normalized_fresnel_weights() -> None:
    light = area_light_quad(LIGHT)
    center = light[0] / np.linalg.norm(light[0])
    for degrees in (0, 30, 60, 85):
        turn = math.radians(degrees)
        across = np.cross(center, UP) / np.linalg.norm(np.cross(center, UP))
        normal = math.cos(turn) * center + math.sin(turn) * across
        view_dir = 2 * (normal @ center) * normal - center  # mirrors the light's center
        surface = (np.zeros((1, 3)), normal[None], view_dir[None])
        reflected = native.sharp_light_reflection(*surface, light, 1.0, 1e-4, IOR)[0]
        fresnel, f0 = fresnel_dielectric(np.array(math.cos(turn)), IOR), ((IOR - 1) / (IOR + 1)) ** 2
        assert reflected == pytest.approx([1, schlick(math.cos(turn)), (fresnel - f0) / (1 - f0)], abs=2e-3)


@pytest.mark.parametrize("n_dot_v", [0.015, -0.2])
def test_cosines_to_the_viewer_have_a_lower_limit(n_dot_v: float) -> None:
    limit, view_dir, light_dir = 0.03, direction_at(math.degrees(math.acos(n_dot_v))), direction_at(60, 180)
    half = (view_dir + light_dir)[0] / np.linalg.norm(view_dir + light_dir)
    expected = ggx_distribution(half[2], 1.0) * smith_g2(0.5, limit, 1.0) / (4 * limit)
    assert terms_of(view_dir, light_dir, 1.0)[0] == pytest.approx(expected, rel=2e-3)


def under_white_sky(view_dir: np.ndarray, alpha: float, count: int = 4000) -> np.ndarray:
    """GGX terms and diffuse radiance (4,) of a surface facing up under a sky of radiance 1, made of far samples."""
    weight = 2 * math.pi / count
    terms = [weight * terms_of(view_dir, light_dir[None], alpha, 100.0) for light_dir in hemisphere(count)]
    total: np.ndarray = np.sum(terms, axis=0)
    return total


@pytest.mark.parametrize("alpha", [0.3, 0.6, 1.0])
def test_energy_under_a_white_sky_is_the_directional_albedo(alpha: float) -> None:
    """At most 1; and equal to the table, which numpy computes by sampling visible normals."""
    table = directional_albedo_table(math.sqrt(alpha), IOR)
    for degrees in (0, 30, 60, 75):
        reflected, metal, dielectric, diffuse = under_white_sky(direction_at(degrees), alpha)
        assert 0.25 < reflected < 1.01
        assert 0 < metal < reflected and 0 < dielectric < reflected
        assert diffuse == pytest.approx(1, abs=0.01)
        albedo = [np.interp(math.cos(math.radians(degrees)), TABLE_COSINES, column) for column in table.T]
        assert albedo == pytest.approx([reflected - metal, metal, reflected - dielectric, dielectric], abs=0.025)


def test_albedo_has_its_known_values_at_both_ends_of_roughness() -> None:
    assert under_white_sky(direction_at(20), 0.15, 20_000)[0] == pytest.approx(1, abs=0.05)
    assert under_white_sky(direction_at(0), 1.0)[0] == pytest.approx(1 - math.log(2), abs=0.002), "in closed form"


def test_the_highlight_is_brightest_in_the_mirror_direction() -> None:
    angles = np.arange(-60, 61)
    view_dirs = np.concatenate([direction_at(angle) for angle in angles])
    surface = (np.zeros((len(angles), 3)), np.tile(UP, (len(angles), 1)), view_dirs)
    light, axis = 3 * direction_at(-25), -direction_at(-25)[0]
    for alpha in (0.04, 0.2):
        reflected = native.specular_radiance(*surface, light, axis, 1.0, alpha, IOR)[0][:, 0]
        assert angles[reflected.argmax()] == pytest.approx(25, abs=2)
    width = np.ptp(angles[reflected > reflected.max() / 2])
    smoother = native.specular_radiance(*surface, light, axis, 1.0, 0.1, IOR)[0][:, 0]
    assert np.ptp(angles[smoother > smoother.max() / 2]) < 0.7 * width


def test_diffuse_radiance_is_irradiance_over_pi() -> None:
    """power n_dot_l cos_at_light / distance^2 / pi; nothing from behind the surface or behind the light."""
    light, axis = np.array([[1.0, 0.0, 2.0]]), np.array([0.0, 0.0, -1.0])
    point, view_dir = np.zeros((1, 3)), direction_at(10)
    expected = 5.0 * (2 / math.sqrt(5)) ** 2 / 5 / math.pi
    diffuse = native.specular_radiance(point, UP[None], view_dir, light, axis, 5.0, 0.3, IOR)[1]
    assert diffuse[0] == pytest.approx(expected, rel=1e-5)
    for dark in ((-UP[None], -view_dir, light, axis), (UP[None], view_dir, light, -axis)):
        specular, diffuse = native.specular_radiance(point, *dark, 5.0, 0.3, IOR)
        assert (specular == 0).all() and (diffuse == 0).all()


def reflections(directions: np.ndarray, blur: float, light: np.ndarray) -> np.ndarray:
    """What mirrors at the origin show of a light to a viewer above, whom they reflect to unit directions (M, 3)."""
    normals, view_dirs = directions + UP, np.tile(UP, (len(directions), 1))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return native.sharp_light_reflection(np.zeros_like(directions), normals, view_dirs, light, 7.0, blur, IOR)


def test_a_mirror_shows_the_square_light_and_nothing_else() -> None:
    """Compared with whether each reflected ray hits the square."""
    light, rng = area_light_quad(LIGHT), np.random.default_rng(0)
    positions = light[0] + rng.uniform(-1, 1, (4000, 2)) @ light[1:]
    inside = (np.abs((positions - light[0]) @ light[1:].T) < 0.5 * (light[1:] ** 2).sum(1)).all(1)
    directions = positions / np.linalg.norm(positions, axis=1, keepdims=True)
    shown = reflections(directions, 1e-4, light)[:, 0]
    assert (np.isclose(shown, 7.0) | np.isclose(shown, 0, atol=1e-3)).mean() > 0.99
    assert ((shown > 3.5) == inside).mean() > 0.995
    assert (reflections(-directions, 1e-4, light) == 0).all(), "behind the mirror"
    flipped = light * [[1.0], [1.0], [-1.0]]  # the other winding
    np.testing.assert_allclose(reflections(directions, 0.05, flipped), reflections(directions, 0.05, light), atol=1e-5)


def test_blur_moves_the_edges_but_takes_no_light_away() -> None:
    light = area_light_quad(LIGHT)
    steps = np.linspace(-1, 1, 401)
    positions = light[0] + steps[:, None] * light[1]
    directions = positions / np.linalg.norm(positions, axis=1, keepdims=True)
    sharp, soft = reflections(directions, 1e-4, light)[:, 0], reflections(directions, 0.04, light)[:, 0]
    assert soft.sum() == pytest.approx(sharp.sum(), rel=0.03)
    assert ((soft > 0.1) & (soft < 6.9)).sum() > 30 > ((sharp > 0.1) & (sharp < 6.9)).sum()
    assert np.abs(steps[np.abs(soft - 3.5).argsort()[:2]]) == pytest.approx(0.5, abs=0.02)


def test_mirror_image_and_smooth_lobe_have_equal_energy() -> None:
    """Summed over normals, either reflects all that the light sends."""
    light, (positions, axes, powers) = area_light_quad(LIGHT), area_light_samples(LIGHT, 36)
    rng = np.random.default_rng(1)
    normals = light[0] / np.linalg.norm(light[0]) + UP + rng.uniform(-0.5, 0.5, (60_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    surface = (np.zeros_like(normals), normals, np.tile(UP, (len(normals), 1)))
    lobe = native.specular_radiance(*surface, positions, axes[0], float(powers[0]), 0.04, IOR)[0].mean(0)
    image = native.sharp_light_reflection(*surface, light, LIGHT_RADIANCE, 1.7 * 0.04, IOR).mean(0)
    assert image[0] == pytest.approx(lobe[0], rel=0.06)


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 3000])
def test_each_point_is_independent_of_the_others(count: int) -> None:
    rng = np.random.default_rng(count)
    points, normals, view_dirs = rng.normal(size=(3, count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    view_dirs /= np.linalg.norm(view_dirs, axis=1, keepdims=True)
    samples = (rng.normal(size=(7, 3)) + 4, np.array([0.0, 0.0, -1.0]), 2.0, 0.2, IOR)
    square = (area_light_quad(LIGHT), 5.0, 0.03, IOR)
    specular, diffuse = native.specular_radiance(points, normals, view_dirs, *samples)
    image = native.sharp_light_reflection(points, normals, view_dirs, *square)
    assert diffuse.shape == (count,) and (diffuse >= 0).all()
    for terms in (specular, image):
        assert terms.shape == (count, 3) and np.isfinite(terms).all() and (terms >= -1e-6).all()
    for row in rng.integers(0, max(count, 1), 5 if count else 0):
        one = slice(row, row + 1)
        surface = (points[one], normals[one], view_dirs[one])
        np.testing.assert_array_equal(native.specular_radiance(*surface, *samples)[0][0], specular[row])
        np.testing.assert_array_equal(native.sharp_light_reflection(*surface, *square)[0], image[row])
