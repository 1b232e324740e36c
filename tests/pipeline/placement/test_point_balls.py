"""A handful of points is drawn as balls, all of them in the frame, whatever places they take."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.interfaces import ScanError, Sensor
from z2p_core.placement.point_balls import MIN_SURFACE_POINTS, POINTS_PER_BALL, points_to_balls
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import place_scan
from z2p_renderer.storage.scans.clouds import Scan

RNG = np.random.default_rng(0)
FEW = {
    "line of five": np.outer(np.arange(5.0), [1, 2, 3]), "upright line": np.outer(np.arange(8.0), [0, 0, 1]),
    "three": np.eye(3), "two places": np.array([[0.0, 0, 0], [1, 0, 0]]), "plane": RNG.normal(size=(20, 3)) * [1, 1, 0],
    "nearly two places": np.array([[0.0, 0, 0], [0, 0, 1e-12], [1, 0, 0]]),
    "most": RNG.normal(size=(MIN_SURFACE_POINTS - 1, 3)),
    "far off": np.add(RNG.normal(size=(9, 3)), [5e5, 5e6, 300]),
}  # fmt: skip


@pytest.mark.parametrize("name", FEW)
def test_each_point_becomes_a_ball_about_it_that_shows(name: str) -> None:
    points = FEW[name]
    balls = points_to_balls(points).reshape(len(points), POINTS_PER_BALL, 3)
    np.testing.assert_allclose(balls.mean(1), points, atol=0.01 * np.ptp(points, axis=0).max())
    radius = np.linalg.norm(balls - points[:, None], axis=2)
    assert np.ptp(radius) < 1e-6 * radius.max() + 1e-8
    assert 0.02 < radius.max() / np.linalg.norm(points - points.mean(0), axis=1).max() < 0.15


@pytest.mark.parametrize("name", FEW)
def test_all_of_it_lies_in_the_frame_and_it_is_told(name: str) -> None:
    points = FEW[name]
    for sensor in (None, Sensor(points.mean(0) - [0, 0, 30], np.eye(3))):
        placed = place_scan(Scan(points, 0, "", sensor), ".pcd", PlacementOptions())
        assert np.linalg.norm(placed.cloud, axis=1).max() <= 1 + 1e-5
        assert len(placed.cloud) == POINTS_PER_BALL * len(points)
        assert f"its {len(points)} points are drawn as balls" in placed.placement.description
        assert placed.placement.outlier_count == placed.placement.background_count == 0


def test_more_points_are_a_surface() -> None:
    points = RNG.normal(size=(MIN_SURFACE_POINTS, 3))
    assert len(place_scan(Scan(points, 0, ""), ".pcd", PlacementOptions()).cloud) == MIN_SURFACE_POINTS


@pytest.mark.filterwarnings("error")
def test_points_closer_than_floats_resolve_are_refused() -> None:
    for size in (1e-200, 1e-321):
        with pytest.raises(ScanError, match="span a finite volume"):
            place_scan(Scan(size * RNG.normal(size=(20, 3)), 0, ""), ".pcd", PlacementOptions())
