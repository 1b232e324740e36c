"""Light between lit points follows the normal and the relief of the points that are shown."""

from __future__ import annotations

import math

import numpy as np
import pytest

from z2p_core import native
from z2p_core.camera import DISTANCE, Camera
from z2p_core.camera_placement.placed_camera import PlacedCamera
from z2p_core.shading.area_light import area_light_samples

CAMERA = Camera(128, 128)
LIGHT = (3.6, 30.0, 45.0)
FACING = np.array([0, 0, -1], np.float32)


def wall(depth_of_grooves: float) -> np.ndarray:
    """Points (N, 3) of a wall in camera axes, with vertical grooves."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 260), np.linspace(-0.5, 0.5, 260))
    depth = DISTANCE + depth_of_grooves * (np.abs(x.ravel() % 0.1 - 0.05) < 0.012)
    return np.column_stack([x.ravel(), y.ravel(), depth]).astype(np.float32)


def occlusion(points: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    normals = np.repeat(FACING[None], len(points), axis=0)
    return native.fine_occlusion(points, normals, CAMERA, light, 1.5, 0.04)


def test_a_flat_wall_hides_nothing() -> None:
    sky, direct = occlusion(wall(0.0), np.array([0.0, -1, 0]))
    assert sky.min() > 0.99 and direct.min() > 0.99


def test_grooves_are_darker_inside() -> None:
    points = wall(0.02)
    sky, direct = occlusion(points, np.array([3.0, 0.0, DISTANCE - 0.6]))  # nearly along the wall, across the grooves
    inside = points[:, 2] > DISTANCE + 0.01
    assert sky[inside].mean() < 0.85 < 0.97 < sky[~inside].mean()
    assert direct[inside].mean() < 0.6 < 0.95 < direct[~inside].mean()


def test_relief_looks_alike_along_parallel_rays_in_oblong_pixels() -> None:
    points = wall(0.02)
    camera = PlacedCamera(128, 64, 0.0, (128.0, 64.0), (64.0, 32.0), parallel=True)
    normals, light = np.repeat(FACING[None], len(points), axis=0), np.array([3.0, 0.0, DISTANCE - 0.6])
    sky, direct = native.fine_occlusion(points, normals, camera, light, 1.5, 0.04)
    inside = points[:, 2] > DISTANCE + 0.01
    assert sky[inside].mean() < 0.85 < 0.97 < sky[~inside].mean()
    assert direct[inside].mean() < 0.6 < 0.95 < direct[~inside].mean()


def test_light_without_obstacles_is_that_without_casters() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (300, 3)).astype(np.float32)
    normals = rng.normal(size=(300, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    samples = area_light_samples(LIGHT, 16)
    far = native.ShadowCasters(np.float32([[0, 0, 40]]), np.zeros(1, np.int32), 0.1)
    shadowed = native.direct_lighting(points, normals, far, *samples, 0.01, 1.0)[0]
    np.testing.assert_allclose(native.unshadowed_light(points, normals, *samples), shadowed, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("tilt", [0.0, 10.0, 20.0])
def test_vector_irradiance_gives_the_light_of_other_normals(tilt: float) -> None:
    points, normals = np.float32([[0, 0, 0.5]]), np.float32([[0, 0, 1]])
    axes = np.asarray(native_axes(400))
    nothing = np.full((2 * len(axes), 1), -1, np.int32)
    floor = native.Floor(-1.0, 4.5, np.zeros((4, 3)), np.array([0, 0, -1.0]), 0.0, 1.0, 0.0)
    empty = np.zeros((2, 2), np.float32)
    vector = native.gather_vectors(
        points, normals, axes, nothing, np.zeros((2, 1), np.float32), 0.5, floor, empty, empty
    )[0]
    angle = math.radians(tilt)
    expected = (1 + math.cos(angle)) / 2  # of a sky of radiance 1 over a black floor
    assert vector @ [math.sin(angle), 0, math.cos(angle)] == pytest.approx(expected, abs=0.03)


def native_axes(count: int) -> np.ndarray:
    from z2p_core.shading.area_light import hemisphere_axes

    return hemisphere_axes(count)


def test_interpolated_values_lie_between_those_of_neighbors() -> None:
    points = np.float32([[0, 0, 0], [1, 0, 0], [0.5, 0.1, 0]])
    normals = np.repeat(FACING[None], 3, axis=0)
    values = np.float32([[0.0, 5.0], [1.0, 5.0], [9.0, 5.0]])
    normals[2] = -FACING  # of the other side: it hardly counts
    places = np.float32([[0.1, 0, 0], [0.9, 0, 0]])
    neighbors = np.int32([[0, 2, 1], [1, 2, 0]])
    result = native.interpolate_values(places, normals[:2], neighbors, points, normals, values)
    assert 0 < result[0, 0] < 0.4 and 0.6 < result[1, 0] < 1.01
    np.testing.assert_allclose(result[:, 1], 5.0, rtol=1e-5)
