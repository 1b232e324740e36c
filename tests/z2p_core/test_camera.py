"""The camera by itself; that Blender shares it is tested in tests/pipeline/rendering/test_conventions.py."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.camera import DEPTH_RANGE, DISTANCE, Camera, light_position, turn


@pytest.mark.parametrize("elevation", [0.0, 20.0, 80.0])
def test_origin_projects_to_the_center_at_camera_distance(elevation: float) -> None:
    pixels, depth = Camera(300, 200, elevation).project(np.zeros((1, 3)))
    np.testing.assert_allclose(pixels, [[150, 100]], atol=1e-9)
    np.testing.assert_allclose(depth, DISTANCE)


def test_axes_are_opencv() -> None:
    camera = Camera(256, 256, 30.0)
    np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.rotation) == pytest.approx(1.0)
    right, up, near = np.eye(3)[0] * 0.5, np.eye(3)[2] * 0.5, camera.position / DISTANCE
    pixels, depth = camera.project(np.stack([right, up, near, np.zeros(3)]))
    assert pixels[0, 0] > 128 and pixels[1, 1] < 128  # +X to the right, +Z up in the picture
    assert depth[2] == pytest.approx(DISTANCE - 1) and depth[2] < depth[3]


@pytest.mark.parametrize(("width", "height"), [(256, 256), (320, 180), (180, 320)])
def test_unit_sphere_fits_into_images_of_any_shape(width: int, height: int) -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(2000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    pixels, depth = Camera(width, height, 35.0).project(points)
    assert (pixels > 0).all() and (pixels < (width, height)).all()
    assert depth.min() > DEPTH_RANGE[0] - 0.001 and depth.max() < DEPTH_RANGE[1] + 0.001


def test_depth_range_is_exact() -> None:
    assert DEPTH_RANGE == (2.6, 4.6), "weights have learned from depths between exactly these"


def test_projection_agrees_with_the_matrices() -> None:
    camera = Camera(320, 240, 47.0)
    points = np.random.default_rng(1).uniform(-0.5, 0.5, size=(50, 3))
    in_camera = (points - camera.position) @ camera.rotation.T
    homogeneous = in_camera @ camera.intrinsics.T
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(pixels, homogeneous[:, :2] / homogeneous[:, 2:], atol=1e-9)
    np.testing.assert_allclose(depth, homogeneous[:, 2])


def test_float32_clouds_stay_float32_and_precise() -> None:
    points = np.random.default_rng(2).uniform(-0.5, 0.5, size=(500, 3))
    camera = Camera(512, 512)
    exact, _ = camera.project(points)
    single, depth = camera.project(points.astype(np.float32))
    assert single.dtype == depth.dtype == np.float32
    np.testing.assert_allclose(single, exact, atol=1e-3)


def test_frame_coordinates_are_those_of_the_full_square_frame() -> None:
    u, v = Camera(64, 64).frame_coordinates()
    assert u.shape == v.shape == (64, 64) and u.dtype == np.float32
    assert u[0, 0] == pytest.approx(0.5 / 64) and v[-1, 0] == pytest.approx(63.5 / 64)
    coarse, _ = Camera(64, 64).frame_coordinates(step=4)
    np.testing.assert_allclose(coarse[0, 0], u[0, :4].mean(), atol=1e-7)
    wide, _ = Camera(128, 64).frame_coordinates()
    np.testing.assert_allclose(wide[0, 32:96], u[0], atol=1e-6)  # the square in the middle is the same frame


def test_light_is_placed_relative_to_the_camera() -> None:
    np.testing.assert_allclose(light_position((4.0, 0.0, 0.0)), [0, -4, 0], atol=1e-12)  # behind the camera
    np.testing.assert_allclose(light_position((4.0, 90.0, 0.0)), [4, 0, 0], atol=1e-12)  # image right
    np.testing.assert_allclose(light_position((4.0, 33.0, 90.0)), [0, 0, 4], atol=1e-12)


def test_turn_is_counter_clockwise_from_above() -> None:
    np.testing.assert_allclose(turn(90.0) @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(turn(40.0) @ turn(-40.0), np.eye(3), atol=1e-12)
