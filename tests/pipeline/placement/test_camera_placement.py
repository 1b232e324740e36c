"""Clouds before cameras of the user's: set upright, lit from the camera's side, and refused where nothing is seen."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.interfaces import ScanError, SettingError
from z2p_core.pinhole import LookAt, PinholeCamera, aimed_camera, pinhole_camera
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import PlacedCloud, place_scan
from z2p_renderer.storage.scans.clouds import Scan

MIDDLE = np.array([30.0, 40.0, 50.0])
SIZE = (200, 160)


def cloud() -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(600, 3))
    return MIDDLE + 2.0 * points / np.linalg.norm(points, axis=1, keepdims=True)


def place(camera: PinholeCamera | LookAt, up: str = "+Z") -> PlacedCloud:
    return place_scan(Scan(cloud(), 0, ""), ".npy", PlacementOptions(up=up, camera=camera), 20.0, (0.0, 80.0))


def looking(eye: tuple[float, float, float], target: tuple[float, float, float] = (0, 0, 0)) -> PinholeCamera:
    """A camera that stands and looks at points relative to the cloud's middle."""
    up = np.array([0.0, 0.0, 1.0])
    return aimed_camera(MIDDLE + np.array(eye), MIDDLE + np.array(target), up, SIZE, 40, None)


@pytest.mark.parametrize("up", ["+Z", "+Y"])
def test_points_keep_their_pixels(up: str) -> None:
    camera = looking((7, -3, 4), (0.5, 0.2, 0))
    placed = place(camera, up)
    assert placed.camera is not None and placed.pinhole == camera
    expected, depth = camera.project(cloud())
    pixels, world_depth = placed.camera.project(placed.cloud.astype(np.float64))
    np.testing.assert_allclose(pixels, expected, atol=1e-3)
    np.testing.assert_allclose(world_depth * placed.viewpoint.radius, depth, atol=1e-4)


def test_the_camera_stands_in_front_so_that_the_light_stays_at_its_side() -> None:
    for eye in ((7, -3, 4), (-7, 1, 2), (0, 8, 1)):
        placed = place(looking(eye))
        assert placed.camera is not None
        x, y, z = placed.camera.position
        assert x == pytest.approx(0, abs=1e-2) and y < 0 and z > 0


@pytest.mark.parametrize(
    ("eye", "target", "reason"),
    [((6, -4, 3), (0, 0, 0), ""), ((6, -4, -6), (0, 0, 0), "below the floor"), ((0.1, 0.1, 0), (1, 0, 0), "inside"),
     ((0, 0, 9), (0, 0, 0), "steeply"), ((1.7, -1.5, 0.9), (0, 0, 0), "perspective"),
     ((200, -50, 80), (0, 0, 0), "tiny")],
)  # fmt: skip
def test_views_that_weights_do_not_know_are_drawn_without_them(
    eye: tuple[float, float, float], target: tuple[float, float, float], reason: str
) -> None:
    placed = place(looking(eye, target))
    assert reason in placed.unfamiliar and bool(reason) == bool(placed.unfamiliar)
    assert ("drawn without the network" in placed.placement.description) == bool(reason)


def test_weights_of_one_elevation_know_no_other() -> None:
    options = PlacementOptions(up="+Z", camera=looking((6, -4, 3)))
    placed = place_scan(Scan(cloud(), 0, ""), ".npy", options, 60.0, None)
    assert "only the elevation of 60 degrees" in placed.unfamiliar


@pytest.mark.parametrize(
    ("eye", "target", "message"),
    [((6, -4, 3), (12, -8, 6), "behind the camera"), ((6, -4, 3), (9, 9, 3), "outside the camera's picture"),
     ((1e6, 0, 0), (0, 0, 0), "times its own radius")],
)  # fmt: skip
def test_clouds_that_are_not_seen_are_refused(
    eye: tuple[float, float, float], target: tuple[float, float, float], message: str
) -> None:
    with pytest.raises(ScanError, match=message):
        place(looking(eye, target))


def test_a_camera_without_a_target_looks_at_the_middle() -> None:
    placed = place(LookAt((36.0, 36.0, 53.0), size=SIZE))
    assert placed.pinhole is not None
    np.testing.assert_allclose(placed.pinhole.project(MIDDLE[None])[0], [[100, 80]], atol=5)


def test_a_scale_makes_the_picture_as_large_as_the_cloud() -> None:
    placed = place(LookAt(pixels_per_unit=50.0))
    assert placed.pinhole is not None
    pixels, _ = placed.pinhole.project(cloud())
    assert placed.pinhole.width == pytest.approx(4 * 50 * 1.1, abs=4)
    assert (pixels > 0).all() and (pixels < [placed.pinhole.width, placed.pinhole.height]).all()
    np.testing.assert_allclose(np.ptp(pixels[:, 0]), 200, rtol=0.02)
    with pytest.raises(SettingError, match="choose a scale of at most"):
        place(LookAt(pixels_per_unit=5000.0))


def test_pictures_that_are_too_large_are_refused() -> None:
    camera = pinhole_camera([[9000, 0, 4000], [0, 9000, 3000], [0, 0, 1]], np.eye(3), [-30, -40, -40], (8000, 6000))
    with pytest.raises(SettingError, match="--resolution"):
        place(camera)
