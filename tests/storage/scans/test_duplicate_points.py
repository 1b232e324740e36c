"""Duplicate points and fill values are removed, and the measured points keep their order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from z2p_core.interfaces import ScanError
from z2p_renderer.storage.scans.clouds import read_clouds, usable
from z2p_renderer.storage.scans.duplicate_points import drop_duplicates


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(3).normal(size=(2000, 3))


def test_different_points_all_stay(points: np.ndarray) -> None:
    assert drop_duplicates(points) is points
    assert drop_duplicates(points[:3]).shape == (3, 3)
    few = np.vstack([points, points[:9]])
    assert drop_duplicates(few) is few


@pytest.mark.parametrize("times", [2, 6, 20])
def test_exact_copies_of_a_cloud_are_dropped(points: np.ndarray, times: int) -> None:
    assert np.array_equal(drop_duplicates(np.repeat(points, times, axis=0)), points)
    assert np.array_equal(drop_duplicates(np.tile(points, (times, 1))), points)


@pytest.mark.parametrize(("times", "off"), [(2, 1e-7), (3, 1e-5), (10, 1e-6), (3, 3e-4)])
def test_near_copies_of_a_cloud_are_dropped(times: int, off: float) -> None:
    rng = np.random.default_rng(5)
    sphere = rng.normal(size=(3000, 3))
    sphere = sphere / np.linalg.norm(sphere, axis=1, keepdims=True) + 4000.0
    copies = np.vstack([sphere, *(sphere + rng.normal(0, off, sphere.shape) for _ in range(times - 1))])
    kept = drop_duplicates(copies)
    assert 0.98 * len(sphere) < len(kept) < 1.02 * len(sphere)
    assert {tuple(row) for row in kept} <= {tuple(row) for row in copies}
    gaps = np.linalg.norm(kept[:500, None] - kept[None, :500], axis=2) + 9 * np.eye(500)
    assert gaps.min() > off


def test_dense_regions_and_grids_are_no_duplicates() -> None:
    rng = np.random.default_rng(6)
    sheet = np.column_stack([rng.random((4000, 2)), np.zeros(4000)])
    dense = np.vstack([sheet, sheet * 0.05])  # 400 times as dense in a corner
    along, across = np.tile(np.linspace(0, 1, 2000), 4), np.repeat(np.linspace(0, 1, 4), 2000)
    lines = np.column_stack([along, across, np.zeros(8000)])
    voxels = np.stack(np.meshgrid(*[np.arange(18.0)] * 3), -1).reshape(-1, 3)
    some = np.vstack([sheet, sheet[:400] + 1e-6])  # too few to show
    for cloud in (dense, lines, voxels, some, sheet[:16], sheet * 0):
        assert len(drop_duplicates(cloud)) == len(np.unique(cloud, axis=0))


def test_negative_zero_equals_zero(points: np.ndarray) -> None:
    flat = points * (1, 1, 0)
    assert len(drop_duplicates(np.vstack([flat, flat * (1, 1, -1)]))) == len(points)


@pytest.mark.parametrize(("mark", "share"), [((0, 0, 0), 0.02), ((0, 0, 0), 0.6), ((-9999, -9999, -9999), 0.1)])
def test_fill_values_are_dropped(points: np.ndarray, mark: tuple[float, ...], share: float) -> None:
    missing = np.random.default_rng(1).random(len(points)) < share
    cloud = np.where(missing[:, None], mark, points)
    assert np.array_equal(drop_duplicates(cloud), points[~missing])


def test_a_measured_origin_stays(points: np.ndarray) -> None:
    points[7] = 0
    assert drop_duplicates(points) is points
    assert len(drop_duplicates(np.repeat(points, 20, axis=0))) == len(points)


def test_a_shared_triangle_corner_is_no_fill_value() -> None:
    """The center of a fan comes once for each triangle, and is a measured point all the same."""
    angle = np.linspace(0, 2 * np.pi, 31)
    rim = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    fan = np.stack([np.full((30, 3), (0.0, 0.0, 1.0)), rim[:-1], rim[1:]], axis=1).reshape(-1, 3)
    assert len(drop_duplicates(fan)) >= 31


def test_dropped_and_repeated_rows_are_counted(tmp_path: Path, points: np.ndarray) -> None:
    np.save(tmp_path / "twice.npy", np.vstack([points, points, [[np.nan, 0, 0]]]))
    (scan,) = read_clouds(tmp_path / "twice.npy")
    assert (len(scan.points), scan.repeated, scan.dropped) == (len(points), len(points), 1)


def test_coordinates_beyond_float32_are_dropped(points: np.ndarray) -> None:
    points[:40, 2] = np.finfo(np.float32).max
    points[40:50] = -1.7e308
    scan = usable(points)
    assert (len(scan.points), scan.dropped) == (1950, 50)
    with pytest.raises(ScanError, match="none of the 2000 points is a place"):
        usable(np.full((2000, 3), 1e300))
