"""Which way is up and where to look from: right on made clouds, silent on ordinary ones."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import box, chair, lamppost, moved, sphere

from z2p_core.camera import turn
from z2p_core.interfaces import Sensor
from z2p_core.placement.depth_camera import METRES, MILLIMETRES, implied_sensor
from z2p_core.placement.view_selection import choose_view, view_from_sensor
from z2p_core.rotations import random_rotation
from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_core.up_axis.choose import choose_up


def depth_picture(rotation: np.ndarray | None = None) -> np.ndarray:
    """What a depth camera at the origin sees of a ball before a wall, OpenCV axes; then turned by `rotation`."""
    u, v = np.meshgrid(np.linspace(-0.4, 0.4, 120), np.linspace(-0.3, 0.3, 90))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    centre, radius = np.array([0.1, 0.05, 1.5]), 0.3
    a, b, c = (rays**2).sum(1), rays @ centre, centre @ centre - radius**2
    inside = b**2 - a * c
    depth = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, 3.0)
    points = rays * depth[:, None]
    return points if rotation is None else points @ rotation.T


def test_up_by_convention() -> None:
    for suffix, axis in {".obj": "+Y", ".glb": "+Y", ".gltf": "+Y", ".ply": "+Z", ".xyz": "+Z"}.items():
        up = choose_up(sphere(1000), None, suffix)
        assert (up.axis, up.sensor) == (axis, None)
        assert np.array_equal(up.rotation, UP_ROTATIONS[axis])
        assert up.reason


def test_up_of_a_sensor_is_its_own_in_whatever_axes_the_file_has() -> None:
    for seed in range(4):
        rotation = random_rotation(np.random.default_rng(seed))
        up = choose_up(depth_picture(rotation) + 7, Sensor(np.full(3, 7.0), rotation), ".obj")
        np.testing.assert_allclose(up.rotation @ rotation @ [0, -1, 0], [0, 0, 1], atol=1e-12)
        np.testing.assert_allclose(up.rotation @ rotation @ [1, 0, 0], [1, 0, 0], atol=1e-12)  # right stays right
        assert up.axis == "the sensor's -Y"


def test_a_scanner_that_sees_all_around_says_nothing_of_up() -> None:
    up = choose_up(box(3000, 4, 3, 1.5), Sensor(np.zeros(3), np.eye(3)), ".pcd")
    assert (up.axis, up.sensor) == ("+Z", None)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_depth_picture_from_the_origin_is_found_out(sign: float) -> None:
    axes = np.diag([1.0, sign, sign])
    up = choose_up(depth_picture(axes), None, ".ply")
    assert up.axis == {1.0: "-Y", -1.0: "+Y"}[sign]
    assert "origin" in up.reason
    assert up.sensor is not None and np.array_equal(up.sensor.rotation, axes)


def test_a_depth_image_in_millimetres_is_recognized() -> None:
    points = depth_picture() * 1000
    assert implied_sensor(points) is None
    assert implied_sensor(points, (METRES, MILLIMETRES)) is not None
    assert choose_up(points, None, ".ply", (METRES, MILLIMETRES)).axis == "-Y"
    assert implied_sensor(sphere(5000) * 300 + [0, 0, 1000], (METRES, MILLIMETRES)) is None


def test_a_relief_in_a_narrow_cone_is_a_depth_picture() -> None:
    """A cheek, say, seen askew, which hides next to nothing of itself: little over an eighth of a ball."""
    ball = sphere(40_000)
    patch = ball[(ball[:, 2] < -0.25) & (ball[:, :2] > -0.3).all(1)][:1400]
    relief = patch * [0.15, 0.15, 0.12] + [0, 0, 0.8]
    assert implied_sensor(relief) is not None
    assert implied_sensor(relief * [3.5, 3.5, 1]) is None  # as wide as it is far: other things are, too


def terrain() -> np.ndarray:
    x, y = np.random.default_rng(3).uniform(-50, 50, (2, 20000))
    return np.column_stack([x, y, 400 + 8 * np.sin(x / 9) * np.cos(y / 7)])


@pytest.mark.parametrize(
    "points",
    [sphere(5000), moved(sphere(5000), 0, 0, 4), chair(3000), moved(chair(3000), 0, 0, 4),
     moved(lamppost(2000), 0, 0, 1), moved(box(5000, 1, 1, 1), 0, 0, 5),
     depth_picture()[::50], depth_picture() * 1000, terrain()],
    ids=["ball", "ball above", "chair", "chair above", "lamppost", "box above", "few points", "huge", "terrain"],
)  # fmt: skip
def test_other_clouds_are_no_depth_pictures(points: np.ndarray) -> None:
    assert implied_sensor(points) is None
    assert choose_up(points, None, ".ply").sensor is None


def shuffled(points: np.ndarray) -> np.ndarray:
    return points[np.random.default_rng(9).permutation(len(points))]


@pytest.mark.parametrize("count", [900, 30_000])  # the larger ones are thinned
def test_placement_ignores_point_order(count: int) -> None:
    rng = np.random.default_rng(4)
    for points in (chair(count), rng.normal(size=(count, 3)) * [1, 0.9, 0.8], depth_picture()):
        up, again = (choose_up(cloud, None, ".ply") for cloud in (points, shuffled(points)))
        assert (up.axis, up.reason, up.other, up.sensor is None) == (
            again.axis, again.reason, again.other, again.sensor is None)  # fmt: skip
        assert choose_view(points) == choose_view(shuffled(points))


def test_another_axis_that_may_be_up_is_passed_on() -> None:
    assert choose_up(sphere(2000), None, ".ply").other == "+Y"
    assert choose_up(sphere(2000), None, ".ply", usual=("-Y", "its family's")).axis == "-Y"


def test_a_sensors_view_has_the_sensor_behind_the_camera() -> None:
    for towards in np.random.default_rng(5).normal(size=(20, 3)):
        azimuth, elevation = view_from_sensor(towards)
        turned = turn(azimuth) @ towards
        angle = np.radians(elevation)
        np.testing.assert_allclose(turned / np.linalg.norm(turned), [0, -np.cos(angle), np.sin(angle)], atol=1e-9)
    assert view_from_sensor(np.array([0.0, -2.0, 0.0])) == (0.0, 0.0)
    assert view_from_sensor(np.array([0.0, 0.0, 2.0])) == (0.0, 90.0)


@pytest.mark.parametrize("own", [0.0, 40.0, -75.0])
def test_a_long_object_is_seen_from_its_side(own: float) -> None:
    points = box(4000, 0.2, 1.0, 0.4) @ turn(own).T
    azimuth, reason = choose_view(points)
    along = turn(azimuth + own) @ [0.0, 1.0, 0.0]
    assert 0.7 < abs(along[0]) < 0.99
    assert reason
    assert choose_view(points) == (azimuth, reason)


def test_a_tie_goes_to_the_front() -> None:
    assert abs(choose_view(sphere(5000))[0]) == 22.5


def test_a_lamps_arm_shows() -> None:
    for own in (0.0, 90.0):
        azimuth, _ = choose_view(lamppost(2000) @ turn(own).T)
        assert abs((turn(azimuth + own) @ [1.0, 0.0, 0.0])[0]) > 0.6
