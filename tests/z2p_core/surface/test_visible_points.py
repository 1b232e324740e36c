"""An image shows the means of the points in front, whatever their order."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import DISTANCE, Camera
from z2p_core.camera_placement.placed_camera import PlacedCamera
from z2p_core.camera_placement.zoomed_camera import zoomed_camera
from z2p_core.placement.zoom import Zoom
from z2p_core.surface.visible_points import visible_points

CAMERA = Camera(64, 64)
PIXEL = DISTANCE / CAMERA.focal


def sphere(count: int, radius: float = 0.9) -> np.ndarray:
    directions = np.random.default_rng(0).normal(size=(count, 3))
    return (radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)


def spacing_of(count: int, radius: float = 0.9) -> float:
    return float(np.sqrt(4 * np.pi * radius**2 / count))


def test_what_lies_behind_is_left_out() -> None:
    cloud = np.concatenate([sphere(200_000), sphere(20_000, 0.5)])
    shown = visible_points(cloud, None, CAMERA, spacing_of(200_000), 0.0).points
    assert np.linalg.norm(shown, axis=1).min() > 0.85
    toward_viewer = shown @ (CAMERA.position / DISTANCE)
    assert toward_viewer.min() > -0.2  # the far side begins at 0.9 cos(76 degrees) = 0.23; its rim may show
    assert toward_viewer.max() > 0.89


def test_no_part_of_the_front_is_missing() -> None:
    cloud = sphere(200_000)
    shown, _ = CAMERA.project(visible_points(cloud, None, CAMERA, spacing_of(200_000), 0.0).points.astype(np.float64))
    pixels, _ = CAMERA.project(cloud.astype(np.float64))
    assert {tuple(p) for p in np.floor(pixels).astype(int)} == {tuple(p) for p in np.floor(shown).astype(int)}


def test_points_of_a_cell_are_averaged() -> None:
    rng = np.random.default_rng(1)
    wall = np.column_stack([rng.uniform(-0.5, 0.5, 300_000), rng.normal(0, 0.01, 300_000),
                            rng.uniform(-0.5, 0.5, 300_000)]).astype(np.float32)  # fmt: skip
    shown = visible_points(wall, wall, CAMERA, 0.002, 0.01)
    assert len(shown.points) < 40_000 and shown.numbers.sum() > 200_000
    assert shown.points[:, 1].std() < 0.5 * 0.01
    np.testing.assert_allclose(shown.values, shown.points, atol=1e-5)


def test_the_order_of_points_does_not_matter() -> None:
    cloud = sphere(50_000)
    shuffled = cloud[np.random.default_rng(2).permutation(len(cloud))]
    first, second = (visible_points(c, c, CAMERA, spacing_of(50_000), 0.0) for c in (cloud, shuffled))
    assert np.array_equal(first.points, second.points) and np.array_equal(first.values, second.values)


def test_a_cloud_beside_the_image_shows_nothing() -> None:
    away = sphere(1000) + np.float32([50, 0, 0])
    assert len(visible_points(away, None, CAMERA, 0.1, 0.0).points) == 0


def test_users_cameras_see_what_the_usual_one_sees() -> None:
    cloud = sphere(50_000)
    usual = visible_points(cloud, None, CAMERA, spacing_of(50_000), 0.0).points
    placed = zoomed_camera(64, 64, CAMERA.elevation, Zoom(1.0, (0.0, 0.0)))
    same = visible_points(cloud, None, placed, spacing_of(50_000), 0.0).points
    np.testing.assert_allclose(len(same), len(usual), rtol=0.02)
    assert set(map(tuple, np.round(same, 4))) & set(map(tuple, np.round(usual, 4)))
    zoomed = zoomed_camera(64, 64, CAMERA.elevation, Zoom(8.0, (0.0, 0.0)))
    near = visible_points(cloud, None, zoomed, spacing_of(50_000), 0.0).points
    pixels, _ = zoomed.project(near.astype(np.float64))
    assert len(near) > 200 and (pixels >= 0).all() and (pixels < 64).all()
    assert (near @ CAMERA.position > 0).all()


def test_parallel_rays_see_the_front_in_oblong_pixels() -> None:
    cloud = np.concatenate([sphere(100_000), sphere(10_000, 0.5)])
    camera = PlacedCamera(80, 40, 0.0, (40.0, 20.0), (40.0, 20.0), station=(0.0, -100.0, 0.0), parallel=True)
    shown = visible_points(cloud, None, camera, spacing_of(100_000), 0.0).points
    assert np.linalg.norm(shown, axis=1).min() > 0.8 and shown[:, 1].max() < 0.35
    pixels, _ = camera.project(shown.astype(np.float64))
    everywhere, _ = camera.project(cloud.astype(np.float64))
    assert {tuple(p) for p in np.floor(everywhere).astype(int)} == {tuple(p) for p in np.floor(pixels).astype(int)}


def test_walls_near_and_far_are_merged_as_finely_as_they_are_seen() -> None:
    x, z = np.random.default_rng(3).uniform(-1, 1, (2, 200_000))
    near = np.column_stack([0.2 * x - 0.2, np.full_like(x, 0.5), 0.2 * z])
    far = np.column_stack([2 * x + 2, np.full_like(x, 8.0), 2 * z])
    walls = np.concatenate([near, far]).astype(np.float32)
    camera = PlacedCamera(64, 64, 0.0, (64.0, 64.0), (32.0, 32.0), station=(0.0, 0.0, 0.0))
    shown = visible_points(walls, None, camera, 0.005, 0.0).points
    is_near = shown[:, 1] < 1
    pixels, _ = camera.project(shown.astype(np.float64))
    for wall in (pixels[is_near], pixels[~is_near]):
        cells = np.floor(2 * wall).astype(int)
        assert len(wall) > 500 and len({tuple(cell) for cell in cells}) > 0.95 * len(wall)
