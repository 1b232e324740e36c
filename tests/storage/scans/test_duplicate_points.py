"""Points that come twice and places that stand for missing ones: what stays is what was measured, in its order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from z2p_core.interfaces import ScanError
from z2p_renderer.storage.scans.clouds import read_clouds, usable
from z2p_renderer.storage.scans.duplicate_points import distinct


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(3).normal(size=(2000, 3))


def test_points_that_differ_all_stay(points: np.ndarray) -> None:
    assert distinct(points) is points
    assert distinct(points[:3]).shape == (3, 3)
    few = np.vstack([points, points[:9]])
    assert distinct(few) is few


@pytest.mark.parametrize("times", [2, 6, 20])
def test_a_cloud_given_several_times_is_the_cloud(points: np.ndarray, times: int) -> None:
    assert np.array_equal(distinct(np.repeat(points, times, axis=0)), points)
    assert np.array_equal(distinct(np.tile(points, (times, 1))), points)


@pytest.mark.parametrize(("times", "off"), [(2, 1e-7), (3, 1e-5), (10, 1e-6), (3, 3e-4)])
def test_a_cloud_given_again_with_other_last_digits_is_the_cloud(times: int, off: float) -> None:
    rng = np.random.default_rng(5)
    sphere = rng.normal(size=(3000, 3))
    sphere = sphere / np.linalg.norm(sphere, axis=1, keepdims=True) + 4000.0
    copies = np.vstack([sphere, *(sphere + rng.normal(0, off, sphere.shape) for _ in range(times - 1))])
    kept = distinct(copies)
    assert 0.98 * len(sphere) < len(kept) < 1.02 * len(sphere)
    assert {tuple(row) for row in kept} <= {tuple(row) for row in copies}
    gaps = np.linalg.norm(kept[:500, None] - kept[None, :500], axis=2) + 9 * np.eye(500)
    assert gaps.min() > off


def test_dense_parts_scan_lines_and_pairs_are_no_copies() -> None:
    rng = np.random.default_rng(6)
    sheet = np.column_stack([rng.random((4000, 2)), np.zeros(4000)])
    dense = np.vstack([sheet, sheet * 0.05])  # 400 times as dense in a corner
    along, across = np.tile(np.linspace(0, 1, 2000), 4), np.repeat(np.linspace(0, 1, 4), 2000)
    lines = np.column_stack([along, across, np.zeros(8000)])
    voxels = np.stack(np.meshgrid(*[np.arange(18.0)] * 3), -1).reshape(-1, 3)
    some = np.vstack([sheet, sheet[:400] + 1e-6])  # too few to show
    for cloud in (dense, lines, voxels, some, sheet[:16], sheet * 0):
        assert len(distinct(cloud)) == len(np.unique(cloud, axis=0))


def test_zero_has_no_sign(points: np.ndarray) -> None:
    flat = points * (1, 1, 0)
    assert len(distinct(np.vstack([flat, flat * (1, 1, -1)]))) == len(points)


@pytest.mark.parametrize(("mark", "share"), [((0, 0, 0), 0.02), ((0, 0, 0), 0.6), ((-9999, -9999, -9999), 0.1)])
def test_a_place_that_stands_for_missing_points_goes(points: np.ndarray, mark: tuple[float, ...], share: float) -> None:
    missing = np.random.default_rng(1).random(len(points)) < share
    cloud = np.where(missing[:, None], mark, points)
    assert np.array_equal(distinct(cloud), points[~missing])


def test_an_origin_that_was_measured_stays(points: np.ndarray) -> None:
    points[7] = 0
    assert distinct(points) is points
    assert len(distinct(np.repeat(points, 20, axis=0))) == len(points)


def test_corners_of_triangles_count_once_for_all_of_them() -> None:
    """A fan's middle comes as often as it has triangles, and is a point all the same."""
    angle = np.linspace(0, 2 * np.pi, 31)
    rim = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    fan = np.stack([np.full((30, 3), (0.0, 0.0, 1.0)), rim[:-1], rim[1:]], axis=1).reshape(-1, 3)
    assert len(distinct(fan)) >= 31


def test_what_was_left_out_is_counted(tmp_path: Path, points: np.ndarray) -> None:
    np.save(tmp_path / "twice.npy", np.vstack([points, points, [[np.nan, 0, 0]]]))
    (scan,) = read_clouds(tmp_path / "twice.npy")
    assert (len(scan.points), scan.repeated, scan.dropped) == (len(points), len(points), 1)


def test_numbers_beyond_all_coordinates_are_none(points: np.ndarray) -> None:
    points[:40, 2] = np.finfo(np.float32).max
    points[40:50] = -1.7e308
    scan = usable(points)
    assert (len(scan.points), scan.dropped) == (1950, 50)
    with pytest.raises(ScanError, match="none of the 2000 points is a place"):
        usable(np.full((2000, 3), 1e300))
