"""A user's camera in the world: it sees the same pixels there, and the usual camera is one of them."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.camera import Camera, turn
from z2p_core.pinhole import PinholeCamera, pinhole_camera
from z2p_core.placement.familiar_views import roll_degrees, unfamiliar_view
from z2p_core.placement.placed_camera import PlacedCamera, place_camera
from z2p_core.placement.usual_camera import usual_pinhole
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.rotations import random_rotation

UPRIGHT = Viewpoint((0.0, 0.0, 0.0), 1.0, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), 20.0)


def utm() -> Viewpoint:
    rows = random_rotation(np.random.default_rng(1)).tolist()
    return Viewpoint((5e5, 4e6, 100.0), 12.5, tuple(tuple(row) for row in rows), 0.0)


@pytest.mark.parametrize("orthographic", [False, True])
def test_the_world_has_the_same_pixels_as_the_data(orthographic: bool) -> None:
    rng, viewpoint = np.random.default_rng(0), utm()
    points = np.array(viewpoint.centre) + rng.normal(size=(50, 3))
    rotation = random_rotation(rng)
    translation = -rotation @ np.array(viewpoint.centre) + [0, 0, 40]
    camera = pinhole_camera([[700, 0, 111.5], [0, 690, 99], [0, 0, 1]], rotation, translation, (256, 200),
                            orthographic=orthographic)  # fmt: skip
    placed = place_camera(camera, viewpoint)
    world = np.array([viewpoint.rotation]) @ ((points - viewpoint.centre) / viewpoint.radius)[..., None]
    pixels, depth = placed.project(world[..., 0])
    np.testing.assert_allclose(pixels, camera.project(points)[0], atol=1e-5)
    np.testing.assert_allclose(placed.unproject(pixels, depth), world[..., 0], atol=1e-9)
    if not orthographic:
        np.testing.assert_allclose(depth * viewpoint.radius, camera.project(points)[1], atol=1e-6)


def test_the_usual_camera_is_a_pinhole_camera() -> None:
    usual = Camera(320, 200, 35.0)
    placed = place_camera(usual_pinhole(utm(), 320, 200, 35.0), utm())
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (20, 3))
    for ours, theirs in zip(placed.project(points), usual.project(points), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-5)
    np.testing.assert_allclose(placed.frame_coordinates(), usual.frame_coordinates(), atol=1e-5)
    np.testing.assert_allclose(placed.depth_range, usual.depth_range, atol=1e-6)
    assert placed.elevation == pytest.approx(35)
    assert unfamiliar_view(placed, -1.0) == ""


def test_a_resized_camera_sees_the_same_view() -> None:
    placed = place_camera(usual_pinhole(UPRIGHT, 320, 200, 35.0), UPRIGHT)
    point = np.array([[0.3, 0.2, 0.1]])
    np.testing.assert_allclose(placed.resized(640, 400).project(point)[0], 2 * placed.project(point)[0])
    assert placed.resized(640, 400).pixels_per_unit == pytest.approx(2 * placed.pixels_per_unit)


def seen_from(distance: float, elevation: float, roll: float = 0.0, zoom: float = 1.0) -> PlacedCamera:
    """A camera that looks at the origin."""
    usual = Camera(256, 256, elevation)
    rotation = turn(roll) @ usual.rotation
    position = usual.position * distance / 3.6
    intrinsics = usual.intrinsics * [[zoom], [zoom], [1]]
    intrinsics[:2, 2] = 128
    camera: PinholeCamera = pinhole_camera(intrinsics, rotation, -rotation @ position, (256, 256))
    return place_camera(camera, UPRIGHT)


@pytest.mark.parametrize(
    ("camera", "reason"),
    [
        (seen_from(3.6, 20), ""), (seen_from(3.6, 20, zoom=3), ""), (seen_from(8, 60), ""), (seen_from(3.6, 20, 5), ""),
        (seen_from(3.6, -20), "below the floor"), (seen_from(0.5, 10), "inside"), (seen_from(1.2, 30), "perspective"),
        (seen_from(3.6, 88), "steeply"), (seen_from(3.6, 20, 40), "rolled by"), (seen_from(40, 20), "tiny"),
    ],
)  # fmt: skip
def test_what_weights_do_not_know_has_a_reason(camera: PlacedCamera, reason: str) -> None:
    found = unfamiliar_view(camera, -0.8)
    assert reason in found and bool(reason) == bool(found)


def test_the_roll_is_measured_in_the_picture() -> None:
    assert roll_degrees(seen_from(3.6, 30, 25)) == pytest.approx(25, abs=1e-6)
    assert roll_degrees(seen_from(3.6, 30)) == pytest.approx(0, abs=1e-9)
