"""Margins: what is written for them, and what they do to the object before the camera."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from z2p_core.camera import Camera
from z2p_core.interfaces import SettingError
from z2p_core.placement.margin import DEFAULT_MARGIN, parse_margin, radius_with_margin, with_margin, without_margin
from z2p_core.placement.viewpoint import frame_points


@pytest.mark.parametrize("wish", [0.1, "0.1", 10, "10", "10%", " 10 % ", np.float64(0.1)], ids=repr)
def test_a_share_and_percent_are_the_same(wish: Any) -> None:
    assert parse_margin(wish) == pytest.approx(0.1)


@pytest.mark.parametrize(
    "wish", [0.46, 46, -0.01, True, "x", "", "%", float("nan"), float("inf"), 10**400, 1j, [0.1], "nan%"], ids=repr
)
def test_what_leaves_no_room_or_is_no_share_is_refused(wish: Any) -> None:
    with pytest.raises(SettingError, match="margin: expected a share"):
        parse_margin(wish)


@pytest.mark.parametrize(("width", "height", "elevation"), [(512, 512, 20.0), (300, 200, 0.0), (200, 300, 75.0)])
@pytest.mark.parametrize("margin", [0.0, 0.05, DEFAULT_MARGIN, 0.3])
def test_a_sphere_leaves_just_that_margin(width: int, height: int, elevation: float, margin: float) -> None:
    rng = np.random.default_rng(0)
    sphere = rng.normal(size=(20000, 3))
    sphere *= radius_with_margin(margin) / np.linalg.norm(sphere, axis=1)[:, None]
    pixels, _ = Camera(width, height, elevation).project(sphere)
    free = min(pixels.min(0).min(), (np.array([width, height]) - pixels.max(0)).min())
    assert free / min(width, height) == pytest.approx(margin, abs=0.004)


def test_the_default_margin_is_neutral_and_margins_invert() -> None:
    assert radius_with_margin(None) == 1 and radius_with_margin(DEFAULT_MARGIN) == pytest.approx(1)
    points = np.random.default_rng(1).normal(size=(50, 3))
    own = frame_points(points, np.eye(3), 20.0)
    assert with_margin(own, None) is own
    wide = with_margin(own, 0.3)
    assert np.allclose(wide.place(points), own.place(points) * radius_with_margin(0.3), atol=1e-6)
    assert without_margin(wide, 0.3).radius == pytest.approx(own.radius)
