"""Which way is up, where to look from and what to leave out: right on made clouds, silent on ordinary ones."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.camera import turn
from z2p_core.framing import (
    METRES,
    MILLIMETRES,
    UP_AXES,
    choose_up,
    choose_view,
    clip_outliers,
    implied_sensor,
    sensor_view,
)
from z2p_core.geometry import bounding_sphere, random_rotation
from z2p_core.interfaces import Sensor


def sphere(count: int, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def box(count: int, *half: float) -> np.ndarray:
    """Points on the sides of a box, evenly by area."""
    rng, sides = np.random.default_rng(1), np.array(half)
    area = np.prod(sides) / sides
    axis = rng.choice(3, size=count, p=area / area.sum())
    points = rng.uniform(-1, 1, (count, 3))
    points[np.arange(count), axis] = rng.choice([-1, 1], size=count)
    return points * sides


def moved(points: np.ndarray, *by: float) -> np.ndarray:
    return points + np.array(by)


def lamppost(count: int) -> np.ndarray:
    rng = np.random.default_rng(2)
    pole = np.column_stack([rng.normal(0, 0.02, (count, 2)), rng.uniform(0, 6, count)])
    few = count // 5
    arm = np.column_stack([rng.uniform(-1.4, 0, few), rng.normal(0, 0.02, few), np.full(few, 6.0)])
    return np.vstack([pole, arm])


def chair(count: int) -> np.ndarray:
    seat, back = box(count, 0.5, 0.5, 0.03), moved(box(count, 0.5, 0.03, 0.5), 0, 0.5, 0.5)
    legs = [moved(box(count // 8, 0.02, 0.02, 0.4), x, y, -0.43) for x in (-0.46, 0.46) for y in (-0.46, 0.46)]
    return np.vstack([seat, back, *legs])


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


CLEAN = {
    "sphere": sphere(5000), "sparse sphere": sphere(500), "few": sphere(40), "chair": chair(1500),
    "lamppost": lamppost(1500), "sparse lamppost": lamppost(400), "plate": box(3000, 1, 1, 0.001),
    "two balls": np.vstack([sphere(2000), sphere(2000) + 5.0]), "far away": moved(sphere(3000), 5e5, 5e6, 100),
}  # fmt: skip


@pytest.mark.parametrize("name", CLEAN)
def test_a_clean_object_loses_no_point(name: str) -> None:
    assert clip_outliers(CLEAN[name]).all()


@pytest.mark.parametrize("distance", [4.0, 1e3, 1e9])
def test_strays_are_left_out_whatever_their_distance(distance: float) -> None:
    thing = chair(2000)
    strays = np.vstack([thing, [[distance, 0, 0], [0, -distance / 2, 0]], moved(sphere(20) * 0.1, 0, 0, distance)])
    kept = clip_outliers(strays)
    assert kept[: len(thing)].all()
    assert not kept[len(thing) :].any()
    assert np.array_equal(clip_outliers(strays[::-1]), kept[::-1])


def test_no_more_than_two_percent_go_and_strays_that_do_no_harm_stay() -> None:
    thing = sphere(1000)
    many = np.vstack([thing, *(sphere(9, seed) * 0.01 + direction * 5 for seed, direction in enumerate(sphere(5, 9)))])
    assert (~clip_outliers(many)).sum() <= 0.02 * len(many)
    assert clip_outliers(np.vstack([thing, [[0, 0, 0]]])).all()  # inside: nothing would be won
    assert clip_outliers(np.vstack([thing, [[1.05, 0, 0]]])).all()


def test_a_large_detached_part_is_part_of_the_object() -> None:
    assert clip_outliers(np.vstack([sphere(1000), sphere(60) * 0.2 + 4.0])).all()


def test_up_by_convention() -> None:
    for suffix, axis in {".obj": "+Y", ".glb": "+Y", ".gltf": "+Y", ".ply": "+Z", ".xyz": "+Z"}.items():
        up = choose_up(sphere(1000), None, suffix)
        assert (up.axis, up.sensor) == (axis, None)
        assert np.array_equal(up.rotation, UP_AXES[axis])
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


def test_a_depth_picture_in_millimetres_is_found_where_that_may_be() -> None:
    points = depth_picture() * 1000
    assert implied_sensor(points) is None
    assert implied_sensor(points, (METRES, MILLIMETRES)) is not None
    assert choose_up(points, None, ".ply", (METRES, MILLIMETRES)).axis == "-Y"
    assert implied_sensor(sphere(5000) * 300 + [0, 0, 1000], (METRES, MILLIMETRES)) is None


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
    assert choose_up(points, None, ".ply").axis == "+Z"


def test_a_sensors_view_has_the_sensor_behind_the_camera() -> None:
    for towards in np.random.default_rng(5).normal(size=(20, 3)):
        azimuth, elevation = sensor_view(towards)
        turned = turn(azimuth) @ towards
        angle = np.radians(elevation)
        np.testing.assert_allclose(turned / np.linalg.norm(turned), [0, -np.cos(angle), np.sin(angle)], atol=1e-9)
    assert sensor_view(np.array([0.0, -2.0, 0.0])) == (0.0, 0.0)
    assert sensor_view(np.array([0.0, 0.0, 2.0])) == (0.0, 90.0)


@pytest.mark.parametrize("own", [0.0, 40.0, -75.0])
def test_a_long_thing_is_seen_from_its_side_and_a_little_from_its_end(own: float) -> None:
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


def test_the_clipped_sphere_is_that_of_the_object() -> None:
    thing = chair(2000)
    points = np.vstack([thing, [[30.0, 0, 0]]])
    assert bounding_sphere(points[clip_outliers(points)]) == bounding_sphere(thing)
