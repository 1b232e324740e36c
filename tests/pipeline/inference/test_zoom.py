"""A part of the frame, enlarged: `zoom` and `pan`."""

from __future__ import annotations

import numpy as np
import pytest

import z2p_core
from z2p_core.camera_placement.zoomed_camera import zoomed_camera
from z2p_core.interfaces import SettingError
from z2p_core.placement.viewpoint import viewpoint_from_json
from z2p_core.placement.zoom import Zoom, parse_zoom
from z2p_renderer.pipeline.cli.viewer.view_state import state_from_json

VIEW = {"size": 64, "view": (30, 20), "up": "+Z"}


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(1500, 3))
    ball: np.ndarray = points / np.linalg.norm(points, axis=1, keepdims=True) * [1, 0.7, 1.2]
    return ball


def test_a_zoom_shows_the_middle_of_a_larger_picture(points: np.ndarray) -> None:
    large = z2p_core.render(points, **{**VIEW, "size": 128}).array[32:96, 32:96].astype(int)
    zoomed = z2p_core.render(points, zoom=2, **VIEW).array.astype(int)
    assert np.abs(zoomed - large).mean() < 4
    assert (zoomed[..., 3] == 255).mean() == pytest.approx((large[..., 3] == 255).mean(), abs=0.02)


def test_a_pan_moves_the_picture_right_and_up(points: np.ndarray) -> None:
    still = z2p_core.render(points, style="balls", **VIEW).array[..., 2].astype(int)
    moved = z2p_core.render(points, style="balls", pan=(0.25, 0.125), **VIEW).array[..., 2].astype(int)
    rows, columns = slice(12, 60), slice(4, 46)
    assert np.abs(np.roll(still, (-8, 16), (0, 1))[rows, columns] - moved[rows, columns]).mean() < 3


def test_the_saved_camera_makes_the_same_bytes(points: np.ndarray) -> None:
    first = z2p_core.render(points, zoom=3, pan=(0.4, -0.5), **VIEW)
    camera = viewpoint_from_json(first.camera.to_json())
    assert camera.zoom == Zoom(3.0, (0.4, -0.5))
    assert np.array_equal(z2p_core.render(points, up="+Z", size=64, camera=camera).array, first.array)
    assert np.array_equal(z2p_core.render(points, up="+Z", camera=first.pinhole).array, first.array)


def test_the_usual_camera_is_a_zoom_of_one() -> None:
    place = np.array([[0.2, -0.3, 0.4]])
    zoomed = zoomed_camera(80, 60, 20.0, Zoom(2.0, (0.1, 0.2)))
    usual = zoomed_camera(80, 60, 20.0, Zoom())
    expected = (usual.project(place)[0] - (40, 30)) * 2 + (40 + 6, 30 - 12)
    assert zoomed.project(place)[0] == pytest.approx(expected)


@pytest.mark.parametrize(("zoom", "pan"), [(0.5, None), (100, None), ("2", None), (2, (1,)), (2, (1, float("nan")))])
def test_what_is_no_zoom_is_refused(zoom: object, pan: object) -> None:
    with pytest.raises(SettingError, match=r"zoom: expected|pan: expected"):
        parse_zoom(zoom, pan)


def test_a_part_of_the_frame_without_the_object_is_refused(points: np.ndarray) -> None:
    with pytest.raises(ValueError, match="beside the part of the frame"):
        z2p_core.render(points, zoom=2, pan=(5, 0), **VIEW)
    with pytest.raises(ValueError, match="both choose the part of the frame"):
        z2p_core.render(points, zoom=2, fit="tight", **VIEW)


def test_a_viewer_writes_zoom_pan_and_radius_as_options_and_keywords() -> None:
    state = state_from_json({"zoom": 2.5, "pan": [0.1, -0.2], "style": "balls", "radius": "2%"})
    assert state.options() == ["--style", "balls", "--radius", "2%", "--zoom", "2.5", "--pan", "0.1,-0.2"]
    assert state.keywords() == {"style": "balls", "radius": "2%", "zoom": 2.5, "pan": (0.1, -0.2)}
