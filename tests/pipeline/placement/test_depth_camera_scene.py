"""A depth camera's scene from file to figure: without its wall, upright by its table, and drawn again the same."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from z2p_core.interfaces import ScanError
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import place_scan, select_points
from z2p_renderer.storage.images.image_files import read_record
from z2p_renderer.storage.scans.clouds import Scan, read_clouds

HEAD = ("VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {width}\nHEIGHT {height}\n"
        "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA ascii\n")  # fmt: skip


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """PCD of a depth camera that looks down by 30 degrees on a ball on a table, before a wall far behind."""
    u, v = np.meshgrid(np.linspace(-0.45, 0.45, 120), np.linspace(-0.35, 0.35, 90))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    angle = np.radians(30)
    down = np.array([0.0, np.cos(angle), np.sin(angle)])  # gravity in the camera's axes
    depth = np.where(rays @ down > 0.05, 0.75 / np.maximum(rays @ down, 1e-9), np.inf)
    depth = np.where(depth < 1.9, depth, np.inf)  # the table's far edge
    centre, radius = np.array([0.0, 0.0, 1.5]) - 0.15 * down, 0.15
    centre = centre + down * (0.75 - radius - centre @ down)
    a, b, c = (rays**2).sum(1), rays @ centre, centre @ centre - radius**2
    inside = b**2 - a * c
    ball = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, np.inf)
    depth = np.minimum(np.minimum(depth, ball), 6.0)
    points = rays * depth[:, None]
    path = tmp_path / "scene.pcd"
    rows = "".join(f"{x:.5f} {y:.5f} {z:.5f}\n" for x, y, z in points)
    path.write_text(HEAD.format(width=120, height=90, points=len(points)) + rows)
    return path


def test_the_wall_goes_and_the_table_is_level(scene: Path) -> None:
    [scan] = read_clouds(scene)
    shown = select_points(scan, ".pcd", PlacementOptions())
    assert shown.background_count > 500 and np.abs(shown.points[:, 2]).max() < 2.5
    placed = place_scan(scan, ".pcd", PlacementOptions(), 20.0, (0.0, 80.0))
    assert placed.placement.up == "the table's normal" and "set upright" in placed.placement.up_reason
    assert placed.placement.elevation == pytest.approx(30, abs=6)
    low = placed.cloud[:, 2] < placed.cloud[:, 2].min() + 0.05
    assert low.mean() > 0.5  # the table lies flat, and is the lowest
    kept = place_scan(scan, ".pcd", PlacementOptions(keep_outliers=True), 20.0, (0.0, 80.0))
    assert len(kept.cloud) == len(scan.points) and kept.placement.background_count == 0
    forced = place_scan(scan, ".pcd", PlacementOptions("-Y"), 20.0, (0.0, 80.0))  # nothing is chosen
    assert forced.placement.background_count == 0


def test_a_gap_in_what_the_camera_measured_is_closed(scene: Path) -> None:
    [scan] = read_clouds(scene)
    ahead = scan.points[:, :2] / scan.points[:, 2:]
    on_the_ball = (np.abs(ahead - [0.0, 0.02]) < 0.02).all(axis=1)
    assert 16 <= on_the_ball.sum() <= 36
    torn = Scan(scan.points[~on_the_ball], 0, "", scan.sensor)
    mended = place_scan(torn, ".pcd", PlacementOptions(), 20.0, (0.0, 80.0))
    assert mended.placement.filled_count >= 4
    assert f"{mended.placement.filled_count} put into small gaps" in mended.placement.description
    assert len(mended.cloud) == len(torn.points) - mended.placement.background_count + mended.placement.filled_count
    centre = scan.points[on_the_ball].mean(0)
    added = select_points(torn, ".pcd", PlacementOptions()).points[-mended.placement.filled_count :]
    assert np.linalg.norm(added - centre, axis=1).max() < 0.06
    left = place_scan(torn, ".pcd", PlacementOptions(smooth=0.0), 20.0, (0.0, 80.0))
    assert left.placement.filled_count == 0 and "gaps" not in left.placement.description
    assert place_scan(torn, ".pcd", PlacementOptions(up="-Y"), 20.0, (0.0, 80.0)).placement.filled_count == 0


def test_the_top_is_cut_off_along_up(scene: Path) -> None:
    [scan] = read_clouds(scene)
    whole = place_scan(scan, ".pcd", PlacementOptions("-Y", "front"), 20.0, None).viewpoint.place(scan.points)
    cut = select_points(scan, ".pcd", PlacementOptions("-Y", "front", cut_top=40.0)).points
    height = -scan.points[:, 1]
    assert -cut[:, 1].min() <= height.max() - 0.4 * np.ptp(height)
    assert 0 < len(cut) < len(whole)
    few = Scan(np.array([[0.0, 0, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]]), 0, "")
    with pytest.raises(ScanError, match="--cut-top 50 leaves 1 points"):
        select_points(few, ".ply", PlacementOptions(cut_top=50.0))


def test_a_smoothed_scan_is_recorded_and_rerendered_alike(
    render: Callable[..., Result], z2p: Callable[..., Result], tiny_weights: Path, scene: Path, tmp_path: Path
) -> None:
    result = render(scene, "--json", "--cut-top", 10)
    assert result.exit_code == 0, result.output
    [stance] = json.loads(result.stdout)["stances"]
    assert stance["background"] > 500
    assert f"; {stance['background']} points far behind it left out" in result.stderr
    figure = tmp_path / "out" / "scene.png"
    assert read_record(figure)["placing"]["cut_top"] == 10
    assert z2p("rerender", figure, "--weights", tiny_weights).exit_code == 0
    assert (tmp_path / "out" / "scene_2.png").read_bytes() == figure.read_bytes()


def test_a_series_that_begins_with_a_depth_camera_looks_from_it(
    render: Callable[..., Result], scene: Path, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    np.save(tmp_path / "apart.npy", rng.normal(size=(3000, 3)) * 0.1 + (0.0, 0.0, -2.0))  # behind the camera
    result = render(scene, tmp_path / "apart.npy", "--same-frame")
    assert result.exit_code == 0, result.output
    told = result.stderr.splitlines()[0]
    assert told.startswith("one frame for 2 clouds: up the table's normal: ") and told.endswith(": from the sensor")
    [scan] = read_clouds(scene)
    alone = place_scan(scan, ".pcd", PlacementOptions(), 20.0, (0.0, 80.0)).viewpoint
    for name in ("scene", "apart"):
        camera = read_record(tmp_path / "out" / f"{name}.png")["camera"]
        assert camera["rotation"] == [list(row) for row in alone.rotation]
        assert camera["elevation"] == pytest.approx(alone.elevation)


def test_a_room_gets_a_hint(render: Callable[..., Result], tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    x, y, z = rng.uniform(-2.5, 2.5, 4000), rng.uniform(-2, 2, 4000), rng.uniform(0, 2.6, 4000)
    flat = [np.column_stack([x, y, np.full(4000, level)]) for level in (0.0, 2.6)]
    np.save(tmp_path / "room.npy", np.vstack([*flat, np.column_stack([np.full(4000, 2.5), y, z])]))
    assert "it looks like a room: --cut-top 40 --elevation 55 shows its inside" in render(tmp_path / "room.npy").stderr
    whole = Image.open(tmp_path / "out" / "room.png").tobytes()
    cut = render(tmp_path / "room.npy", "--cut-top", 40, "--overwrite")
    assert "looks like a room" not in cut.stderr
    assert Image.open(tmp_path / "out" / "room.png").tobytes() != whole
