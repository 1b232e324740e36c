"""Albedo of surface points from colors near them, and light that carries it."""

import numpy as np
import pytest

from z2p_core.camera import Camera
from z2p_core.interfaces import PointColors
from z2p_core.scene import SceneDescription
from z2p_core.shading.textured_light import NEUTRAL_GREY, neutral_albedo, surface_albedo
from z2p_core.surface.normals import estimate_surface
from z2p_renderer.plugins.gbuffers.surfels import Surfels


def sphere(count: int, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return (points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)


def test_surface_points_have_the_colors_of_their_own_points() -> None:
    cloud = sphere(2000)
    albedo = np.random.default_rng(1).random((2000, 3)).astype(np.float32)
    surface = estimate_surface(cloud, use_normal_gnn=False)
    found = surface_albedo(surface, PointColors(cloud, albedo))
    rows = [int(np.flatnonzero((cloud == point).all(1))[0]) for point in surface.grid.points[::97]]
    np.testing.assert_allclose(found[::97], albedo[rows], atol=1e-6)


def test_colors_far_from_the_surface_do_not_count() -> None:
    cloud = sphere(2000)
    far = np.array([[0, 0, 3.0]], np.float32)
    colors = PointColors(np.vstack([cloud, far]), np.vstack([np.zeros((2000, 3)), np.ones((1, 3))]).astype(np.float32))
    assert surface_albedo(estimate_surface(cloud), colors).max() == 0


def test_points_without_colors_get_those_of_their_neighbors() -> None:
    cloud = sphere(2000)
    upper = cloud[:, 2] > 0
    albedo = np.tile([[0.2, 0.4, 0.6]], (int(upper.sum()), 1)).astype(np.float32)
    found = surface_albedo(estimate_surface(cloud), PointColors(cloud[upper], albedo))
    np.testing.assert_allclose(found, np.tile([[0.2, 0.4, 0.6]], (len(found), 1)), atol=1e-5)


def test_the_neutral_color_is_grey_unless_all_points_have_one() -> None:
    one = np.tile([[0.7, 0.1, 0.05]], (50, 1))
    np.testing.assert_allclose(neutral_albedo(one), [0.7, 0.1, 0.05], rtol=1e-5)
    mixed = np.vstack([one, np.tile([[0.05, 0.1, 0.7]], (50, 1))])
    np.testing.assert_allclose(neutral_albedo(mixed), NEUTRAL_GREY, rtol=1e-5)


def test_a_red_wall_tints_the_white_one_beside_it() -> None:
    rng = np.random.default_rng(0)
    wall, floor = rng.uniform(-0.6, 0.6, (4000, 3)), rng.uniform(-0.6, 0.6, (4000, 3))
    wall[:, 0], floor[:, 2] = -0.6, -0.6
    cloud = np.vstack([wall, floor]).astype(np.float32)
    scene, camera = SceneDescription(material={"Base Color": (0.35, 0.35, 0.35, 1.0)}), Camera(96, 96, 45)
    features = np.empty((10, 96, 96), np.float32)
    tints = []
    for color in ((0.8, 0.02, 0.02), (0.8, 0.8, 0.8)):
        albedo = np.vstack([np.tile(color, (4000, 1)), np.full((4000, 3), 0.8)]).astype(np.float32)
        relative = Surfels().draw_textured_into(features, cloud, PointColors(cloud, albedo), camera, scene)
        pixels, _ = camera.project(np.array([[-0.45, 0.0, -0.6]]))
        column, row = pixels[0].astype(int)
        tints.append(relative[0, row, column] / relative[1, row, column])
    assert tints[0] > 1.03 * tints[1]
    assert tints[1] == pytest.approx(1, abs=0.01)


def test_many_more_colors_than_points_give_their_mean() -> None:
    cloud, colored = sphere(2000), sphere(50_000, seed=3)
    albedo = np.repeat((colored[:, 2:] > 0).astype(np.float32), 3, axis=1)
    surface = estimate_surface(cloud, use_normal_gnn=False)
    found = surface_albedo(surface, PointColors(colored, albedo))
    clear = np.abs(surface.points[:, 2]) > 0.2
    np.testing.assert_allclose(found[clear, 0], (surface.points[clear, 2] > 0).astype(np.float32), atol=1e-6)
