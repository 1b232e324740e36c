"""Cameras in the data's units: plain K [R | t] projection, cameras that look at a point, and their JSON."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from z2p_core.interfaces import SettingError
from z2p_core.pinhole import (
    LookAt,
    aimed_camera,
    camera_from_json,
    look_at,
    look_at_camera,
    pinhole_camera,
    pixels_per_unit,
)
from z2p_core.rotations import random_rotation

K = np.array([[500.0, 0, 310], [0, 520, 250], [0, 0, 1]])


@given(st.integers(0, 2**32 - 1))
def test_projection_is_k_r_t(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotation, translation, points = random_rotation(rng), rng.normal(size=3), rng.normal(size=(20, 3))
    camera = pinhole_camera(K, rotation, translation, (640, 480))
    expected = (K @ (rotation @ points.T + translation[:, None])).T
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(depth, expected[:, 2], atol=1e-9)
    np.testing.assert_allclose(pixels * depth[:, None], expected[:, :2], atol=1e-6)
    np.testing.assert_allclose(camera.unproject(pixels, depth), points, atol=1e-9)
    np.testing.assert_allclose(rotation @ camera.position + translation, 0, atol=1e-12)


def test_orthographic_pixels_do_not_depend_on_depth() -> None:
    camera = pinhole_camera(K, np.eye(3), [0, 0, 7], (640, 480), orthographic=True)
    pixels, depth = camera.project(np.array([[1.0, 2, 3], [1, 2, -30]]))
    np.testing.assert_allclose(pixels, [[810, 1290]] * 2)
    np.testing.assert_allclose(depth, [10, -23])
    np.testing.assert_allclose(camera.unproject(pixels, depth), [[1, 2, 3], [1, 2, -30]])


def test_a_camera_that_looks_at_a_point_sees_it_in_the_middle_and_up_above() -> None:
    camera = look_at_camera(LookAt((4.0, -3.0, 2.0), (1.0, 1.0, 0.5)), (400, 300), (9, 9, 9), (0, 0, 1))
    pixels, depth = camera.project(np.array([[1.0, 1, 0.5], [1, 1, 1.5]]))
    np.testing.assert_allclose(pixels[0], [200, 150])
    assert depth[0] == pytest.approx(np.linalg.norm([3, 4, 1.5]))
    assert pixels[1, 1] < 150 and pixels[1, 0] == pytest.approx(200)
    assert camera.focal[0] == pytest.approx(150 / np.tan(np.radians(20)))


def test_straight_down_north_is_up_as_on_maps() -> None:
    camera = aimed_camera(np.array([0, 0, 9.0]), np.zeros(3), np.array([0, 0, 1.0]), (100, 100), 40, None)
    pixels, _ = camera.project(np.array([[0.0, 1, 0], [1, 0, 0]]))
    assert pixels[0, 1] < 50 and pixels[0, 0] == pytest.approx(50)
    assert pixels[1, 0] > 50 and pixels[1, 1] == pytest.approx(50)


def test_a_scale_in_millimetres_and_a_dpi_give_pixels() -> None:
    assert pixels_per_unit(25.4, 300) == pytest.approx(300)  # a unit is an inch long


def test_json_returns_the_same_camera() -> None:
    camera = pinhole_camera(K, random_rotation(np.random.default_rng(0)), [1, 2, 3], (640, 480), name="left/0.jpg")
    again = camera_from_json(json.loads(json.dumps(camera.to_json())))
    assert again.name == camera.name and (again.width, again.height) == (640, 480)
    np.testing.assert_allclose(again.rotation, camera.rotation, atol=1e-12)
    assert camera.to_json()["K"] == K.tolist()


def test_a_smaller_picture_shows_the_same_view() -> None:
    camera = pinhole_camera(K, np.eye(3), [0, 0, 4], (640, 480)).fitted(320, 320)
    assert (camera.width, camera.height) == (320, 240)
    np.testing.assert_allclose(camera.project(np.array([[0.1, 0.2, 1]]))[0], [[160, 135.4]])


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"R": np.diag([1, 1, -1])}, "rotation matrix"), ({"R": np.eye(3) * 2}, "rotation matrix"),
        ({"K": [[500, 9, 3], [0, 5, 3], [0, 0, 1]]}, "fx, 0, cx"), ({"K": np.diag([0.0, 1, 1])}, "focal"),
        ({"t": [1, 2]}, "3 numbers as t"), ({"t": [1, 2, np.nan]}, "3 numbers as t"), ({"size": (0, 4)}, "width"),
        ({"size": "ab"}, "width"),
    ],
)  # fmt: skip
def test_what_is_no_camera_is_refused_in_words(changes: dict[str, Any], word: str) -> None:
    arguments: dict[str, Any] = {"K": K, "R": np.eye(3), "t": [0, 0, 1], "size": (64, 64), **changes}
    with pytest.raises(SettingError, match=word):
        pinhole_camera(**arguments)


def test_impossible_views_are_refused() -> None:
    with pytest.raises(SettingError, match="another point"):
        look_at_camera(LookAt((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)), (64, 64), (0, 0, 0), (0, 0, 1))
    with pytest.raises(SettingError, match="field of view"):
        look_at((1, 2, 3), fov=200)
    with pytest.raises(SettingError, match="K, R, t"):
        camera_from_json({"K": K.tolist()})
