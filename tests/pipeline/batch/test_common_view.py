"""Clouds of one series share a frame and a floor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from z2p_renderer.pipeline.batch.common_view import common_viewpoint
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import place_scan
from z2p_renderer.storage.scans.clouds import usable


def block(rng: np.random.Generator, *half: float) -> np.ndarray:
    return rng.uniform(-1, 1, (800, 3)) * half


def written(folder: Path, clouds: list[np.ndarray]) -> list[Path]:
    paths = [folder / f"{index}.npy" for index in range(len(clouds))]
    for path, points in zip(paths, clouds, strict=True):
        np.save(path, points)
    return paths


def drawn(folder: Path, clouds: list[np.ndarray]) -> tuple[float, list[np.ndarray]]:
    series = common_viewpoint(written(folder, clouds), PlacementOptions("+Z", "front"), 20.0, None)
    placing = PlacementOptions("+Z", "front", viewpoint=series.viewpoint, grounded=series.grounded)
    assert series.viewpoint.floor is not None
    return series.viewpoint.floor, [place_scan(usable(points), ".npy", placing).cloud for points in clouds]


def test_centered_objects_stand_on_one_floor_in_one_frame(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    clouds = [block(rng, *half) for half in ((1, 1, 1), (0.3, 0.3, 0.2), (1.2, 1, 0.1))]
    clouds = [points - (points.max(0) + points.min(0)) / 2 for points in clouds]
    floor, placed = drawn(tmp_path, clouds)
    for cloud, points in zip(placed, clouds, strict=True):
        assert cloud[:, 2].min() == pytest.approx(floor, abs=1e-5)
        assert np.linalg.norm(cloud, axis=1).max() <= 1.001
        np.testing.assert_allclose(np.ptp(cloud, axis=0) / np.ptp(placed[0], axis=0),
                                   np.ptp(points, axis=0) / np.ptp(clouds[0], axis=0), rtol=1e-4)  # fmt: skip


def test_what_moves_keeps_its_place_above_the_floor_of_all(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    thing = block(rng, 0.5, 0.5, 0.5)
    floor, placed = drawn(tmp_path, [np.add(thing, [0, 0, height]) for height in (0.0, 1.0, 3.0)])
    lows = [float(cloud[:, 2].min()) for cloud in placed]
    assert lows[0] == pytest.approx(floor, abs=1e-6)
    assert np.diff(lows)[1] == pytest.approx(2 * np.diff(lows)[0], rel=1e-4) and lows[1] > floor + 0.1


def test_no_cloud_sinks_into_the_floor_by_its_lowest_point(tmp_path: Path) -> None:
    """The lowest point of a cloud need not be among the farthest ones of any other direction."""
    rng = np.random.default_rng(0)
    bowl = block(rng, 1, 1, 0.3)
    bowl = np.vstack([bowl, np.column_stack([rng.uniform(-0.01, 0.01, (9, 2)), np.full(9, -0.31)])])
    floor, placed = drawn(tmp_path, [bowl, np.add(bowl, [0.5, 0, 0])])
    assert all(float(cloud[:, 2].min()) >= floor - 1e-6 for cloud in placed)


def test_the_order_of_the_points_changes_nothing(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    clouds = [block(rng, 1, 0.6, 0.5), np.add(block(rng, 0.5, 0.6, 0.9), [1.0, 0, 0])]
    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    plain, again = (common_viewpoint(written(tmp_path / name, given), PlacementOptions(), 20.0, None) for name, given in
                    (("a", clouds), ("b", [points[rng.permutation(len(points))] for points in clouds])))  # fmt: skip
    assert plain.viewpoint.rotation == again.viewpoint.rotation and plain.description == again.description
    assert replace(plain.viewpoint, floor=None).radius == pytest.approx(again.viewpoint.radius, rel=1e-9)
