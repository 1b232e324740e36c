"""Scans placed as asked or as found best: forced ways are exact, a sensor's view is the sensor's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from z2p_core.camera import Camera
from z2p_core.interfaces import ScanError, Sensor
from z2p_core.placement.bounding_sphere import random_rotation
from z2p_renderer.pipeline.inference.renderer import UP_AXES, place_cloud
from z2p_renderer.pipeline.placement.place_cloud import Placed, Placing, place
from z2p_renderer.storage.scans.clouds import Scan

FREE = (0.0, 80.0)


def scan(points: np.ndarray, sensor: Sensor | None = None) -> Scan:
    return Scan(points, 0, "", sensor)


def seen(lift: float = 0.0) -> np.ndarray:
    """Half a ball about (0, lift, 3) in OpenCV axes, the half that faces the origin."""
    points = np.random.default_rng(0).normal(size=(3000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points = np.vstack([points, np.eye(3), -np.eye(3)])
    return points[points[:, 2] <= 0] * 0.8 + [0.0, lift, 3.0]


@pytest.mark.parametrize("axis", UP_AXES)
def test_forced_up_and_front_are_the_plain_placement_bit_for_bit(axis: str, cloud: np.ndarray) -> None:
    sensor = Sensor(np.zeros(3), np.eye(3))
    placed = place(scan(cloud, sensor), ".pcd", Placing(axis, "front", 33.0), 20.0, FREE)
    assert np.array_equal(placed.cloud, place_cloud(cloud, axis, 33.0))
    stance = placed.stance
    assert (stance.up, stance.azimuth, stance.elevation, stance.outliers) == (axis, 33.0, None, 0)


def test_auto_frames_a_clean_object_as_it_would_be_framed_by_hand(cloud: np.ndarray) -> None:
    placed = place(scan(cloud), ".ply", Placing(azimuth=10.0), 20.0, FREE)
    assert np.array_equal(placed.cloud, place_cloud(cloud, placed.stance.up, placed.stance.azimuth))
    assert placed.stance.elevation is None
    plain = place(scan(cloud), ".ply", Placing(), 20.0, FREE)
    assert placed.stance.azimuth == plain.stance.azimuth + 10.0


def test_turning_file_and_sensor_together_changes_nothing() -> None:
    points = seen(0.6)
    plain = place(scan(points, Sensor(np.zeros(3), np.eye(3))), ".pcd", Placing(), 20.0, FREE)
    for seed in range(3):
        rotation = random_rotation(np.random.default_rng(seed))
        moved = scan(points @ rotation.T + 9.0, Sensor(np.full(3, 9.0), rotation))
        turned = place(moved, ".pcd", Placing(), 20.0, FREE)
        np.testing.assert_allclose(turned.cloud, plain.cloud, atol=1e-5)
        assert turned.stance.elevation == pytest.approx(plain.stance.elevation, abs=1e-6)


def test_a_sensors_cloud_is_seen_as_the_sensor_saw_it() -> None:
    points = np.vstack([seen(), [[0.0, 0.0, 2.2], [0.5, 0.0, 2.5], [0.0, 0.5, 2.5]]])
    placed = place(scan(points, Sensor(np.zeros(3), np.eye(3))), ".pcd", Placing(), 20.0, FREE)
    assert placed.stance.elevation is not None
    pixel, _ = Camera(200, 200, placed.stance.elevation).project(placed.cloud[len(points) - 3 : len(points)])
    ahead, right, below = pixel
    assert np.abs(ahead - 100).max() < 3  # the optical axis goes through the middle of the cloud
    assert right[0] > ahead[0] + 20 and abs(right[1] - ahead[1]) < 3
    assert below[1] > ahead[1] + 20 and abs(below[0] - ahead[0]) < 3


def test_a_sensors_elevation_is_the_true_one_within_what_the_weights_know() -> None:
    sensor = Sensor(np.zeros(3), np.eye(3))
    below = place(scan(seen(1.0), sensor), ".pcd", Placing(), 20.0, FREE).stance
    assert below.elevation == pytest.approx(np.degrees(np.arctan2(1.0, 3.0)), abs=4)
    above = place(scan(seen(-1.0), sensor), ".pcd", Placing(), 20.0, FREE).stance
    assert above.elevation == 0.0
    assert "beyond the weights' 0 to 80" in above.view_reason
    settled = place(scan(seen(1.0), sensor), ".pcd", Placing(), 20.0, None).stance
    assert settled.elevation is None
    assert settled.azimuth == below.azimuth


def test_forced_up_ignores_the_sensor_unless_it_is_asked_for() -> None:
    sensed = scan(seen(), Sensor(np.zeros(3), np.eye(3)))
    assert place(sensed, ".pcd", Placing("-Y"), 20.0, FREE).stance.elevation is None
    asked = place(sensed, ".pcd", Placing("-Y", "sensor"), 20.0, FREE)
    auto = place(sensed, ".pcd", Placing(), 20.0, FREE)
    np.testing.assert_allclose(asked.cloud, auto.cloud, atol=1e-6)
    assert asked.stance.elevation == auto.stance.elevation


def test_a_sensors_view_needs_a_sensor(cloud: np.ndarray) -> None:
    with pytest.raises(ScanError, match="no sensor to look from"):
        place(scan(cloud), ".ply", Placing(view="sensor"), 20.0, FREE)


def test_a_depth_camera_may_count_in_millimetres() -> None:
    """That is not taken for granted, for hills have the same mark, but told, and done where it is asked for."""
    millimetres, metres = (scan(seen() * 0.5 * unit) for unit in (1000, 1))
    plain = place(millimetres, ".ply", Placing(), 20.0, FREE).stance
    assert "depth camera" not in plain.up_reason and "--view sensor" in plain.told
    asked = place(millimetres, ".ply", Placing(view="sensor"), 20.0, FREE)
    known = place(metres, ".ply", Placing(), 20.0, FREE)
    assert asked.stance.up == known.stance.up and "millimetres" not in asked.stance.told + known.stance.told
    np.testing.assert_allclose(asked.cloud, known.cloud, atol=1e-5)


def test_an_azimuth_may_be_asked_for(cloud: np.ndarray) -> None:
    placed = place(scan(cloud), ".ply", Placing("+Z", 50.0, azimuth=-20.0), 20.0, FREE)
    assert np.array_equal(placed.cloud, place_cloud(cloud, "+Z", 30.0))


def test_strays_are_left_out_and_counted_unless_kept(cloud: np.ndarray) -> None:
    strays = np.vstack([cloud, [[40.0, 4, 5], [3, -60, 5]]])
    placed = place(scan(strays), ".ply", Placing("+Z", "front"), 20.0, FREE)
    assert np.array_equal(placed.cloud, place_cloud(cloud))
    assert placed.stance.outliers == 2
    assert "2 stray points left out of the frame" in placed.stance.told
    kept = place(scan(strays), ".ply", Placing("+Z", "front", keep_outliers=True), 20.0, FREE)
    assert np.array_equal(kept.cloud, place_cloud(strays))
    assert "stray" not in kept.stance.told


def test_a_few_points_far_below_are_left_out_and_the_thing_stands_on_the_floor() -> None:
    slab = np.random.default_rng(0).uniform([-1, -1, -0.2], [1, 1, 0.2], (5000, 3))
    points = np.vstack([slab, [[0.3, 0.2, slab[:, 2].min() - 0.9]]])
    placed = place(scan(points), ".las", Placing())
    assert placed.stance.outliers == 1 and "1 stray point left" in placed.stance.told
    again = place(scan(points), ".las", Placing(viewpoint=placed.viewpoint))
    assert again.stance.outliers == 1 and np.ptp(again.cloud[:, 2]) == pytest.approx(np.ptp(placed.cloud[:, 2]))
    assert place(scan(points), ".las", Placing(keep_outliers=True)).stance.outliers == 0
    lying = replace(placed.viewpoint, rotation=((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))
    assert place(scan(points), ".las", Placing(viewpoint=lying)).stance.outliers == 0  # not below, in that camera


def test_too_few_points_for_a_surface_are_told(cloud: np.ndarray) -> None:
    for count, told in ((20, True), (300, False)):
        line = place(scan(cloud[:: len(cloud) // count][:count]), ".ply", Placing(), 20.0, FREE).stance.told
        assert ("so few points" in line) == told


def test_digits_that_were_lost_in_saving_are_told() -> None:
    """An easting and a northing of six digits: the thing falls apart into stripes."""
    points = np.random.default_rng(2).normal(size=(3000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    lost = np.column_stack([np.round(points[:, :2] * 8), points[:, 2] * 8])
    assert "few different values of x and y" in place(scan(lost), ".xyz", Placing(), 20.0, FREE).stance.told
    x, z = np.random.default_rng(3).random((2, 20_000))
    line_by_line = np.column_stack([x, np.repeat(np.linspace(0, 1, 100), 200), z])
    for clean in (points, np.round(points * 8), points * (1, 1, 0), line_by_line):
        assert "different values" not in place(scan(clean), ".xyz", Placing(), 20.0, FREE).stance.told


def noisy() -> np.ndarray:
    """The same half of the ball by a camera whose depths are off by up to a spacing."""
    rng, points = np.random.default_rng(4), np.random.default_rng(5).normal(size=(16_000, 3))
    points *= 0.8 / np.linalg.norm(points, axis=1, keepdims=True)
    points = points[points[:, 2] <= 0] + [0.0, 0.0, 3.0]
    return points * (1 + rng.normal(scale=0.03, size=(len(points), 1)) / np.linalg.norm(points, axis=1, keepdims=True))


def off_the_ball(placed: Placed) -> float:
    """How far the points lie off the ball that was seen, in radii of the frame."""
    ball = placed.viewpoint.place(np.array([[0.0, 0.0, 3.0]]))
    away = np.linalg.norm(placed.cloud - ball, axis=1) - 0.8 / placed.viewpoint.radius
    return float(np.abs(away).mean())


def test_a_depth_cameras_noisy_cloud_is_made_smooth_unless_asked_otherwise() -> None:
    camera = Sensor(np.zeros(3), np.eye(3))
    made = {smooth: place(scan(noisy(), camera), ".pcd", Placing(smooth=smooth), 20.0, FREE)
            for smooth in ("auto", 0.0, 0.25)}  # fmt: skip
    assert off_the_ball(made["auto"]) < 0.9 * off_the_ball(made[0.0])
    assert off_the_ball(made[0.25]) < off_the_ball(made["auto"])
    for smooth, placed in made.items():
        assert ("made smooth over" in placed.stance.told) == (smooth != 0)
        assert placed.viewpoint == made["auto"].viewpoint
    assert made[0.0].stance.smooth == 0 and made[0.25].stance.smooth == 0.25


def test_other_clouds_are_made_smooth_when_that_is_asked_for_alone() -> None:
    for points, sensor in ((noisy(), None), (seen(), Sensor(np.zeros(3), np.eye(3)))):
        assert place(scan(points, sensor), ".ply", Placing("+Z" if sensor is None else "auto")).stance.smooth == 0
    asked = place(scan(noisy()), ".ply", Placing("+Z", smooth=0.2), 20.0, FREE)
    assert off_the_ball(asked) < 0.7 * off_the_ball(place(scan(noisy()), ".ply", Placing("+Z"), 20.0, FREE))


def test_a_settled_camera_makes_as_smooth_as_the_first_time() -> None:
    camera = Sensor(np.zeros(3), np.eye(3))
    first = place(scan(noisy(), camera), ".pcd", Placing(), 20.0, FREE)
    again = place(scan(noisy(), camera), ".pcd", Placing(viewpoint=first.viewpoint), 20.0, FREE)
    assert again.stance.smooth == first.stance.smooth > 0
    assert np.array_equal(again.cloud, first.cloud)


def test_a_thing_that_others_make_small_is_told(cloud: np.ndarray) -> None:
    few = cloud[: len(cloud) // 40] * 0.01 + [12.0, 0.0, 0.0]  # too many for strays
    assert "strays, to be removed" in place(scan(np.vstack([cloud, few])), ".ply", Placing(), 20.0, FREE).stance.told
    assert "strays" not in place(scan(cloud), ".ply", Placing(), 20.0, FREE).stance.told


def test_a_cloud_that_float32_has_rounded_far_from_the_origin_is_told(cloud: np.ndarray) -> None:
    """Nothing is said where it does not show, nor of numbers that float32 did not hold."""
    far = cloud + np.array([691234.25, 5334567.75, 512.0])
    for points, step in ((cloud, 0.0), (cloud.astype(np.float32).astype(float), 0.0), (far, 0.0),
                         (far.astype(np.float32).astype(float), 0.5)):  # fmt: skip
        stance = place(scan(points), "", Placing()).stance
        assert stance.rounded == step
        assert ("rounded to steps of 0.5" in stance.told) == (step > 0)


def test_a_clump_far_away_is_told_however_many_points_it_has() -> None:
    rng = np.random.default_rng(0)
    thing = rng.normal(size=(3000, 3))
    thing /= np.linalg.norm(thing, axis=1, keepdims=True)
    for count in (40, 300):
        clump = rng.normal(size=(count, 3)) / 10 + (60.0, 0.0, 0.0)
        stance = place(Scan(np.concatenate([thing, clump]), 0, ""), ".xyz", Placing()).stance
        assert "strays" in stance.told or stance.outliers == count
    assert "strays" not in place(Scan(thing, 0, ""), ".xyz", Placing()).stance.told


def test_a_camera_for_other_units_that_shows_next_to_nothing_is_told() -> None:
    thing = np.random.default_rng(0).normal(size=(500, 3))
    placed = place(Scan(thing * 1000, 0, ""), ".xyz", Placing())
    tiny = place(Scan(thing, 0, ""), ".xyz", Placing(viewpoint=placed.viewpoint))
    assert "tiny in this camera's frame" in tiny.stance.told
    assert "tiny" not in place(Scan(thing * 1000, 0, ""), ".xyz", Placing(viewpoint=placed.viewpoint)).stance.told


def test_a_cluster_too_far_to_show_is_left_out_and_told() -> None:
    thing = np.random.default_rng(0).normal(size=(3000, 3))
    points = np.vstack([thing, np.add(thing[:1200], [0, 4000, 0])])
    stance = place(scan(points), ".ply", Placing()).stance
    assert (stance.outliers, stance.far) == (1200, 1200)
    assert "1200 points so far off that next to nothing would show" in stance.told and "--keep-outliers" in stance.told
    kept = place(scan(points), ".ply", Placing(keep_outliers=True)).stance
    assert (kept.outliers, kept.far) == (0, 0) and "far off" not in kept.told


@pytest.mark.parametrize("kind", ["thing", "depth picture", "with strays"])
def test_a_shuffled_cloud_is_placed_as_before_bit_for_bit(kind: str, cloud: np.ndarray) -> None:
    points = {"thing": cloud, "depth picture": seen(0.6), "with strays": np.vstack([cloud, [[40.0, 4, 5]]])}[kind]
    points = points + 0.123456789
    order = np.random.default_rng(3).permutation(len(points))
    plain, again = (place(scan(one), ".ply", Placing()) for one in (points, points[order]))
    assert again.stance == plain.stance and again.viewpoint == plain.viewpoint
    assert np.array_equal(np.sort(again.cloud, axis=0), np.sort(plain.cloud, axis=0))


def test_another_up_that_may_be_is_told_with_what_to_do() -> None:
    ball = np.random.default_rng(0).normal(size=(2000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    told = place(scan(ball), ".ply", Placing()).stance.told
    assert "up may be +Y: --up +Y" in told and "azimuth" in told and "from the file's front" in told
    assert "may be" not in place(scan(ball), ".ply", Placing("+Z")).stance.told
    family = Scan(ball, 0, "", up="-Y", up_reason="the axes of its family", up_certain=False)
    assert place(family, ".ply", Placing()).stance.up == "-Y"


def test_what_turned_the_view_on_is_told_beside_the_whole_azimuth(cloud: np.ndarray) -> None:
    told = place(scan(cloud), ".ply", Placing("+Z", 50.0, azimuth=-20.0)).stance.told
    assert "azimuth 30 from the file's front: as asked, turned on by -20" in told


def test_a_scanner_that_sees_all_around_is_looked_from_where_it_stood(cloud: np.ndarray) -> None:
    thing = cloud - cloud.mean(0)
    beside = Sensor(np.array([5.0, 0.0, 1.0]), np.eye(3))  # its +Z is not towards the thing: no camera
    placed = place(scan(thing, beside), ".pcd", Placing("+Z", "sensor"), 20.0, FREE)
    assert placed.stance.azimuth == pytest.approx(-90, abs=3) and placed.stance.elevation is None
    assert "from its sensor's side" in placed.stance.told
    ahead = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # amid the points, it looks along +X
    amid = place(scan(thing, Sensor(np.zeros(3), ahead)), ".pcd", Placing("+Z", "sensor"), 20.0, FREE)
    assert amid.stance.azimuth == pytest.approx(90) and "ahead" in amid.stance.told
    assert place(scan(thing, Sensor(np.zeros(3), np.eye(3))), ".pcd", Placing("+Z", "sensor")).stance.azimuth


@pytest.mark.parametrize("share", [0.1, 0.05])
def test_a_camera_that_reaches_into_the_thing_is_refused(share: float, cloud: np.ndarray) -> None:
    own = place(scan(cloud), ".ply", Placing("+Z")).viewpoint
    inside = replace(own, radius=own.radius * share)
    with pytest.raises(ScanError, match=r"reaches the camera.*larger|beyond the camera's frame"):
        place(scan(cloud), ".ply", Placing(viewpoint=inside))
    near = place(scan(cloud), ".ply", Placing(viewpoint=replace(own, radius=own.radius * 0.6)))
    assert near.stance.outside > 0


def test_an_odd_floor_and_an_odd_elevation_of_a_camera_are_told(cloud: np.ndarray) -> None:
    own = place(scan(cloud), ".ply", Placing("+Z")).viewpoint
    for change, told in (({"floor": 0.5}, "floor lies above"), ({"floor": -300.0}, "floor lies far below"),
                         ({"elevation": 500.0}, "elevation was changed"), ({}, "")):  # fmt: skip
        hint = place(scan(cloud), ".ply", Placing(viewpoint=replace(own, **change)), 20.0, FREE).stance.hint
        assert told in hint and bool(told) == bool(hint)


def test_a_grid_is_no_loss_of_digits() -> None:
    x, y = (side.ravel() for side in np.meshgrid(np.arange(50.0), np.arange(50.0)))
    rng = np.random.default_rng(0)
    raster = np.column_stack([x, y, np.sin(x / 9) * 8 + rng.normal(0, 0.1, x.size)])
    assert "digits" not in place(scan(raster), ".xyz", Placing("+Z")).stance.told
    torn = rng.normal(size=(20_000, 3)) * [50, 50, 10]
    torn[:, 1] = np.round(torn[:, 1] / 14) * 14
    assert "digits are lost" in place(scan(torn), ".xyz", Placing("+Z", keep_outliers=True)).stance.told
