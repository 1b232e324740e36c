"""One camera for many clouds: exact, kept through JSON, and refused where it cannot be meant."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from z2p_core.camera import turn
from z2p_core.interfaces import ScanError, SettingError
from z2p_core.placement.viewpoint import Viewpoint, frame_points, viewpoint_from_json
from z2p_core.rotations import random_rotation


def points(offset: float = 0.0) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(200, 3)) * (3.0, 1.0, 2.0) + offset


def test_the_cloud_it_was_made_for_fills_the_unit_sphere() -> None:
    for offset in (0.0, 5e6):
        placed = frame_points(points(offset), turn(30.0), 20.0).place(points(offset))
        assert placed.dtype == np.float32
        assert np.linalg.norm(placed, axis=1).max() == pytest.approx(1.0, abs=1e-5)


def test_what_is_placed_can_be_taken_back() -> None:
    viewpoint = frame_points(points(5e6), random_rotation(np.random.default_rng(3)), 20.0)
    np.testing.assert_allclose(viewpoint.unplace(viewpoint.place(points(5e6))), points(5e6), rtol=0, atol=1e-4)


def test_clouds_keep_their_sizes_and_places_beside_each_other() -> None:
    viewpoint = frame_points(points(), random_rotation(np.random.default_rng(1)), 20.0)
    first, second = viewpoint.place(points()), viewpoint.place(points() / 2 + [0.0, 0.0, 1.0])
    true = np.linalg.norm(points() - (points() / 2 + [0.0, 0.0, 1.0]), axis=1)
    np.testing.assert_allclose(np.linalg.norm(first - second, axis=1) * viewpoint.radius, true, rtol=1e-4, atol=1e-5)


def test_json_round_trip_is_exact() -> None:
    viewpoint = frame_points(points(5e6), random_rotation(np.random.default_rng(2)), 33.3)
    for one in (viewpoint, replace(viewpoint, floor=-0.7)):
        assert viewpoint_from_json(json.loads(json.dumps(one.to_json()))) == one
    older = {key: value for key, value in viewpoint.to_json().items() if key != "floor"}
    assert viewpoint_from_json(older) == viewpoint


GOOD = Viewpoint((0.0, 0.0, 0.0), 1.0, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), 20.0).to_json()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"z2p_camera": 2}, "z2p_camera 1"),
        ({"centre": [0, 0]}, "3 numbers as 'centre'"),
        ({"centre": [0, 0, float("nan")]}, "3 numbers as 'centre'"),
        ({"radius": 0}, "above 0"),
        ({"radius": "wide"}, "a number as 'radius'"),
        ({"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "no mirror"),
        ({"rotation": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}, "rotation matrix"),
        ({"floor": "low"}, "a number as 'floor'"),
        ({"elevation": None}, "a number as 'elevation'"),
        ({"distance": 5.0}, "know only distance 3.6"),
        ({"field_of_view": 60}, "know only field_of_view 40"),
    ],
)
def test_refusals(change: dict[str, object], told: str) -> None:
    with pytest.raises(SettingError, match=told):
        viewpoint_from_json({**GOOD, **change})


@pytest.mark.parametrize("data", [None, [], "camera", 3])
def test_other_json_is_no_camera(data: object) -> None:
    with pytest.raises(SettingError, match="--save-camera"):
        viewpoint_from_json(data)


def test_a_cloud_without_extent_has_no_frame() -> None:
    for cloud in (np.empty((0, 3)), np.ones((5, 3))):
        with pytest.raises(ScanError, match="expected points"):
            frame_points(cloud, np.eye(3), 20.0)
