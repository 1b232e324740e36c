"""Scans placed as asked or as found best: forced ways are exact, a sensor's view is the sensor's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from place_cloud import place_cloud

from z2p_core.camera import Camera
from z2p_core.interfaces import ScanError, Sensor
from z2p_core.rotations import random_rotation
from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import PlacedCloud, place_scan
from z2p_renderer.storage.scans.clouds import Scan

FREE = (0.0, 80.0)


def scan(points: np.ndarray, sensor: Sensor | None = None) -> Scan:
    return Scan(points, 0, "", sensor)


def description(points: np.ndarray, suffix: str = ".ply", options: PlacementOptions = PlacementOptions()) -> str:  # noqa: B008
    """What placing a cloud says of it."""
    return place_scan(scan(points), suffix, options, 20.0, FREE).placement.description


def seen(lift: float = 0.0) -> np.ndarray:
    """Half a ball about (0, lift, 3) in OpenCV axes, the half that faces the origin."""
    points = np.random.default_rng(0).normal(size=(3000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points = np.vstack([points, np.eye(3), -np.eye(3)])
    return points[points[:, 2] <= 0] * 0.8 + [0.0, lift, 3.0]


@pytest.mark.parametrize("axis", UP_ROTATIONS)
def test_forced_up_and_front_are_the_plain_placement_bit_for_bit(axis: str, cloud: np.ndarray) -> None:
    sensor = Sensor(np.zeros(3), np.eye(3))
    placed = place_scan(scan(cloud, sensor), ".pcd", PlacementOptions(axis, "front", 33.0), 20.0, FREE)
    assert np.array_equal(placed.cloud, place_cloud(cloud, axis, 33.0))
    stance = placed.placement
    assert (stance.up, stance.azimuth, stance.elevation, stance.outlier_count) == (axis, 33.0, None, 0)


def test_auto_placement_of_a_clean_object_equals_manual(cloud: np.ndarray) -> None:
    placed = place_scan(scan(cloud), ".ply", PlacementOptions(azimuth=10.0), 20.0, FREE)
    assert np.array_equal(placed.cloud, place_cloud(cloud, placed.placement.up, placed.placement.azimuth))
    assert placed.placement.elevation is None
    plain = place_scan(scan(cloud), ".ply", PlacementOptions(), 20.0, FREE)
    assert placed.placement.azimuth == plain.placement.azimuth + 10.0


def test_turning_file_and_sensor_together_changes_nothing() -> None:
    points = seen(0.6)
    plain = place_scan(scan(points, Sensor(np.zeros(3), np.eye(3))), ".pcd", PlacementOptions(), 20.0, FREE)
    for seed in range(3):
        rotation = random_rotation(np.random.default_rng(seed))
        moved = scan(points @ rotation.T + 9.0, Sensor(np.full(3, 9.0), rotation))
        turned = place_scan(moved, ".pcd", PlacementOptions(), 20.0, FREE)
        np.testing.assert_allclose(turned.cloud, plain.cloud, atol=1e-5)
        assert turned.placement.elevation == pytest.approx(plain.placement.elevation, abs=1e-6)


def test_a_sensors_cloud_is_seen_as_the_sensor_saw_it() -> None:
    points = np.vstack([seen(), [[0.0, 0.0, 2.2], [0.5, 0.0, 2.5], [0.0, 0.5, 2.5]]])
    placed = place_scan(scan(points, Sensor(np.zeros(3), np.eye(3))), ".pcd", PlacementOptions(), 20.0, FREE)
    assert placed.placement.elevation is not None
    pixel, _ = Camera(200, 200, placed.placement.elevation).project(placed.cloud[len(points) - 3 : len(points)])
    ahead, right, below = pixel
    assert np.abs(ahead - 100).max() < 3  # the optical axis goes through the middle of the cloud
    assert right[0] > ahead[0] + 20 and abs(right[1] - ahead[1]) < 3
    assert below[1] > ahead[1] + 20 and abs(below[0] - ahead[0]) < 3


def test_a_sensor_view_is_clamped_to_the_weights_elevations() -> None:
    sensor = Sensor(np.zeros(3), np.eye(3))
    below = place_scan(scan(seen(1.0), sensor), ".pcd", PlacementOptions(), 20.0, FREE).placement
    assert below.elevation == pytest.approx(np.degrees(np.arctan2(1.0, 3.0)), abs=4)
    above = place_scan(scan(seen(-1.0), sensor), ".pcd", PlacementOptions(), 20.0, FREE).placement
    assert above.elevation == 0.0
    assert "beyond the weights' 0 to 80" in above.view_reason
    settled = place_scan(scan(seen(1.0), sensor), ".pcd", PlacementOptions(), 20.0, None).placement
    assert settled.elevation is None
    assert settled.azimuth == below.azimuth


def test_forced_up_ignores_the_sensor_unless_it_is_asked_for() -> None:
    sensed = scan(seen(), Sensor(np.zeros(3), np.eye(3)))
    assert place_scan(sensed, ".pcd", PlacementOptions("-Y"), 20.0, FREE).placement.elevation is None
    asked = place_scan(sensed, ".pcd", PlacementOptions("-Y", "sensor"), 20.0, FREE)
    auto = place_scan(sensed, ".pcd", PlacementOptions(), 20.0, FREE)
    np.testing.assert_allclose(asked.cloud, auto.cloud, atol=1e-6)
    assert asked.placement.elevation == auto.placement.elevation


def test_a_sensors_view_needs_a_sensor(cloud: np.ndarray) -> None:
    with pytest.raises(ScanError, match="no sensor to look from"):
        place_scan(scan(cloud), ".ply", PlacementOptions(view="sensor"), 20.0, FREE)


def test_a_depth_camera_may_count_in_millimetres() -> None:
    """That is not taken for granted, for hills have the same mark, but told, and done where it is asked for."""
    millimetres, metres = (scan(seen() * 0.5 * unit) for unit in (1000, 1))
    plain = place_scan(millimetres, ".ply", PlacementOptions(), 20.0, FREE).placement
    assert "depth camera" not in plain.up_reason and "--view sensor" in plain.description
    asked = place_scan(millimetres, ".ply", PlacementOptions(view="sensor"), 20.0, FREE)
    known = place_scan(metres, ".ply", PlacementOptions(), 20.0, FREE)
    assert asked.placement.up == known.placement.up
    assert "millimetres" not in asked.placement.description + known.placement.description
    np.testing.assert_allclose(asked.cloud, known.cloud, atol=1e-5)


def test_an_azimuth_may_be_asked_for(cloud: np.ndarray) -> None:
    placed = place_scan(scan(cloud), ".ply", PlacementOptions("+Z", 50.0, azimuth=-20.0), 20.0, FREE)
    assert np.array_equal(placed.cloud, place_cloud(cloud, "+Z", 30.0))


def test_strays_are_left_out_and_counted_unless_kept(cloud: np.ndarray) -> None:
    strays = np.vstack([cloud, [[40.0, 4, 5], [3, -60, 5]]])
    placed = place_scan(scan(strays), ".ply", PlacementOptions("+Z", "front"), 20.0, FREE)
    assert np.array_equal(placed.cloud, place_cloud(cloud))
    assert placed.placement.outlier_count == 2
    assert "2 stray points left out of the frame" in placed.placement.description
    kept = place_scan(scan(strays), ".ply", PlacementOptions("+Z", "front", keep_outliers=True), 20.0, FREE)
    assert np.array_equal(kept.cloud, place_cloud(strays))
    assert "stray" not in kept.placement.description


def test_low_outliers_are_removed_so_the_object_is_grounded() -> None:
    slab = np.random.default_rng(0).uniform([-1, -1, -0.2], [1, 1, 0.2], (5000, 3))
    points = np.vstack([slab, [[0.3, 0.2, slab[:, 2].min() - 0.9]]])
    placed = place_scan(scan(points), ".las", PlacementOptions())
    assert placed.placement.outlier_count == 1 and "1 stray point left" in placed.placement.description
    again = place_scan(scan(points), ".las", PlacementOptions(viewpoint=placed.viewpoint))
    assert again.placement.outlier_count == 1 and np.ptp(again.cloud[:, 2]) == pytest.approx(np.ptp(placed.cloud[:, 2]))
    assert place_scan(scan(points), ".las", PlacementOptions(keep_outliers=True)).placement.outlier_count == 0
    lying = replace(placed.viewpoint, rotation=((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))
    from_camera = place_scan(scan(points), ".las", PlacementOptions(viewpoint=lying))
    assert from_camera.placement.outlier_count == 0  # not below, in that camera


def test_too_few_points_for_a_surface_are_told(cloud: np.ndarray) -> None:
    for count, told in ((20, True), (300, False)):
        line = description(cloud[:: len(cloud) // count][:count])
        assert ("so few points" in line) == told


def test_digits_that_were_lost_in_saving_are_told() -> None:
    """An easting and a northing of six digits: the thing falls apart into stripes."""
    points = np.random.default_rng(2).normal(size=(3000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    lost = np.column_stack([np.round(points[:, :2] * 8), points[:, 2] * 8])
    assert "few different values of x and y" in description(lost, ".xyz")
    x, z = np.random.default_rng(3).random((2, 20_000))
    line_by_line = np.column_stack([x, np.repeat(np.linspace(0, 1, 100), 200), z])
    for clean in (points, np.round(points * 8), points * (1, 1, 0), line_by_line):
        assert "different values" not in description(clean, ".xyz")


def noisy() -> np.ndarray:
    """The same half of the ball by a camera whose depths are off by up to a spacing."""
    rng, points = np.random.default_rng(4), np.random.default_rng(5).normal(size=(16_000, 3))
    points *= 0.8 / np.linalg.norm(points, axis=1, keepdims=True)
    points = points[points[:, 2] <= 0] + [0.0, 0.0, 3.0]
    return points * (1 + rng.normal(scale=0.03, size=(len(points), 1)) / np.linalg.norm(points, axis=1, keepdims=True))


def off_the_ball(placed: PlacedCloud) -> float:
    """How far the points lie off the ball that was seen, in radii of the frame."""
    ball = placed.viewpoint.place(np.array([[0.0, 0.0, 3.0]]))
    away = np.linalg.norm(placed.cloud - ball, axis=1) - 0.8 / placed.viewpoint.radius
    return float(np.abs(away).mean())


def test_noisy_depth_camera_clouds_are_smoothed_by_default() -> None:
    camera = Sensor(np.zeros(3), np.eye(3))
    made = {smooth: place_scan(scan(noisy(), camera), ".pcd", PlacementOptions(smooth=smooth), 20.0, FREE)
            for smooth in ("auto", 0.0, 0.25)}  # fmt: skip
    assert off_the_ball(made["auto"]) < 0.9 * off_the_ball(made[0.0])
    assert off_the_ball(made[0.25]) < off_the_ball(made["auto"])
    for smooth, placed in made.items():
        assert ("made smooth over" in placed.placement.description) == (smooth != 0)
        assert placed.viewpoint == made["auto"].viewpoint
    assert made[0.0].placement.smoothing_radius == 0 and made[0.25].placement.smoothing_radius == 0.25


def test_other_clouds_are_smoothed_only_on_request() -> None:
    for points, sensor in ((noisy(), None), (seen(), Sensor(np.zeros(3), np.eye(3)))):
        options = PlacementOptions("+Z" if sensor is None else "auto")
        assert place_scan(scan(points, sensor), ".ply", options).placement.smoothing_radius == 0
    asked = place_scan(scan(noisy()), ".ply", PlacementOptions("+Z", smooth=0.2), 20.0, FREE)
    plain = place_scan(scan(noisy()), ".ply", PlacementOptions("+Z"), 20.0, FREE)
    assert off_the_ball(asked) < 0.7 * off_the_ball(plain)


def test_a_settled_camera_makes_as_smooth_as_the_first_time() -> None:
    camera = Sensor(np.zeros(3), np.eye(3))
    first = place_scan(scan(noisy(), camera), ".pcd", PlacementOptions(), 20.0, FREE)
    again = place_scan(scan(noisy(), camera), ".pcd", PlacementOptions(viewpoint=first.viewpoint), 20.0, FREE)
    assert again.placement.smoothing_radius == first.placement.smoothing_radius > 0
    assert np.array_equal(again.cloud, first.cloud)


def test_a_thing_that_others_make_small_is_told(cloud: np.ndarray) -> None:
    few = cloud[: len(cloud) // 40] * 0.01 + [12.0, 0.0, 0.0]  # too many for strays
    assert "strays, to be removed" in description(np.vstack([cloud, few]))
    assert "strays" not in place_scan(scan(cloud), ".ply", PlacementOptions(), 20.0, FREE).placement.description


def test_float32_rounding_far_from_the_origin_is_reported(cloud: np.ndarray) -> None:
    """Nothing is said where it does not show, nor of numbers that float32 did not hold."""
    far = cloud + np.array([691234.25, 5334567.75, 512.0])
    for points, step in ((cloud, 0.0), (cloud.astype(np.float32).astype(float), 0.0), (far, 0.0),
                         (far.astype(np.float32).astype(float), 0.5)):  # fmt: skip
        stance = place_scan(scan(points), "", PlacementOptions()).placement
        assert stance.rounding_step == step
        assert ("rounded to steps of 0.5" in stance.description) == (step > 0)


def test_a_clump_far_away_is_told_however_many_points_it_has() -> None:
    rng = np.random.default_rng(0)
    thing = rng.normal(size=(3000, 3))
    thing /= np.linalg.norm(thing, axis=1, keepdims=True)
    for count in (40, 300):
        clump = rng.normal(size=(count, 3)) / 10 + (60.0, 0.0, 0.0)
        stance = place_scan(Scan(np.concatenate([thing, clump]), 0, ""), ".xyz", PlacementOptions()).placement
        assert "strays" in stance.description or stance.outlier_count == count
    assert "strays" not in place_scan(Scan(thing, 0, ""), ".xyz", PlacementOptions()).placement.description


def test_a_camera_in_other_units_is_reported() -> None:
    thing = np.random.default_rng(0).normal(size=(500, 3))
    placed = place_scan(Scan(thing * 1000, 0, ""), ".xyz", PlacementOptions())
    tiny = place_scan(Scan(thing, 0, ""), ".xyz", PlacementOptions(viewpoint=placed.viewpoint))
    assert "tiny in this camera's frame" in tiny.placement.description
    own = PlacementOptions(viewpoint=placed.viewpoint)
    assert "tiny" not in place_scan(Scan(thing * 1000, 0, ""), ".xyz", own).placement.description


def test_a_cluster_too_far_to_show_is_left_out_and_told() -> None:
    thing = np.random.default_rng(0).normal(size=(3000, 3))
    points = np.vstack([thing, np.add(thing[:1200], [0, 4000, 0])])
    stance = place_scan(scan(points), ".ply", PlacementOptions()).placement
    assert (stance.outlier_count, stance.far_count) == (1200, 1200)
    assert "1200 points so far off that next to nothing would show" in stance.description
    assert "--keep-outliers" in stance.description
    kept = place_scan(scan(points), ".ply", PlacementOptions(keep_outliers=True)).placement
    assert (kept.outlier_count, kept.far_count) == (0, 0) and "far off" not in kept.description


@pytest.mark.parametrize("kind", ["thing", "depth picture", "with strays"])
def test_a_shuffled_cloud_is_placed_as_before_bit_for_bit(kind: str, cloud: np.ndarray) -> None:
    points = {"thing": cloud, "depth picture": seen(0.6), "with strays": np.vstack([cloud, [[40.0, 4, 5]]])}[kind]
    points = points + 0.123456789
    order = np.random.default_rng(3).permutation(len(points))
    plain, again = (place_scan(scan(one), ".ply", PlacementOptions()) for one in (points, points[order]))
    assert again.placement == plain.placement and again.viewpoint == plain.viewpoint
    assert np.array_equal(np.sort(again.cloud, axis=0), np.sort(plain.cloud, axis=0))


def test_another_up_that_may_be_is_told_with_what_to_do() -> None:
    ball = np.random.default_rng(0).normal(size=(2000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    told = place_scan(scan(ball), ".ply", PlacementOptions()).placement.description
    assert "up may be +Y: --up +Y" in told and "azimuth" in told and "from the file's front" in told
    assert "may be" not in place_scan(scan(ball), ".ply", PlacementOptions("+Z")).placement.description
    family = Scan(ball, 0, "", up="-Y", up_reason="the axes of its family", up_certain=False)
    assert place_scan(family, ".ply", PlacementOptions()).placement.up == "-Y"


def test_the_users_azimuth_is_reported_beside_the_total(cloud: np.ndarray) -> None:
    told = place_scan(scan(cloud), ".ply", PlacementOptions("+Z", 50.0, azimuth=-20.0)).placement.description
    assert "azimuth 30 from the file's front: as asked, turned on by -20" in told


def test_a_panoramic_scan_is_viewed_from_the_scanner(cloud: np.ndarray) -> None:
    thing = cloud - cloud.mean(0)
    beside = Sensor(np.array([5.0, 0.0, 1.0]), np.eye(3))  # its +Z is not towards the thing: no camera
    placed = place_scan(scan(thing, beside), ".pcd", PlacementOptions("+Z", "sensor"), 20.0, FREE)
    assert placed.placement.azimuth == pytest.approx(-90, abs=3) and placed.placement.elevation is None
    assert "from its sensor's side" in placed.placement.description
    ahead = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # amid the points, it looks along +X
    amid = place_scan(scan(thing, Sensor(np.zeros(3), ahead)), ".pcd", PlacementOptions("+Z", "sensor"), 20.0, FREE)
    assert amid.placement.azimuth == pytest.approx(90) and "ahead" in amid.placement.description
    from_inside = scan(thing, Sensor(np.zeros(3), np.eye(3)))
    assert place_scan(from_inside, ".pcd", PlacementOptions("+Z", "sensor")).placement.azimuth


@pytest.mark.parametrize("share", [0.1, 0.05])
def test_a_camera_that_reaches_into_the_thing_is_refused(share: float, cloud: np.ndarray) -> None:
    own = place_scan(scan(cloud), ".ply", PlacementOptions("+Z")).viewpoint
    inside = replace(own, radius=own.radius * share)
    with pytest.raises(ScanError, match=r"reaches the camera.*larger|beyond the camera's frame"):
        place_scan(scan(cloud), ".ply", PlacementOptions(viewpoint=inside))
    near = place_scan(scan(cloud), ".ply", PlacementOptions(viewpoint=replace(own, radius=own.radius * 0.6)))
    assert near.placement.outside_count > 0


def test_an_odd_floor_and_an_odd_elevation_of_a_camera_are_told(cloud: np.ndarray) -> None:
    own = place_scan(scan(cloud), ".ply", PlacementOptions("+Z")).viewpoint
    for change, told in (({"floor": 0.5}, "floor lies above"), ({"floor": -300.0}, "floor lies far below"),
                         ({"elevation": 500.0}, "elevation was changed"), ({}, "")):  # fmt: skip
        options = PlacementOptions(viewpoint=replace(own, **change))
        hint = place_scan(scan(cloud), ".ply", options, 20.0, FREE).placement.hint
        assert told in hint and bool(told) == bool(hint)


def test_a_grid_is_no_loss_of_digits() -> None:
    x, y = (side.ravel() for side in np.meshgrid(np.arange(50.0), np.arange(50.0)))
    rng = np.random.default_rng(0)
    raster = np.column_stack([x, y, np.sin(x / 9) * 8 + rng.normal(0, 0.1, x.size)])
    assert "digits" not in place_scan(scan(raster), ".xyz", PlacementOptions("+Z")).placement.description
    torn = rng.normal(size=(20_000, 3)) * [50, 50, 10]
    torn[:, 1] = np.round(torn[:, 1] / 14) * 14
    assert "digits are lost" in description(torn, ".xyz", PlacementOptions("+Z", keep_outliers=True))
