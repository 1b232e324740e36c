"""`z2p render`: views from the sensors of depth cameras."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from PIL import Image


@pytest.fixture
def organised(tmp_path: Path) -> Path:
    """PCD file of a depth camera's picture: a tilted wall below the optical axis."""
    u, v = np.meshgrid(np.linspace(-0.3, 0.3, 30), np.linspace(0.1, 0.5, 20))
    depth = 3.0 - 2 * v
    points = np.column_stack([(u * depth).ravel(), (v * depth).ravel(), depth.ravel()])
    head = ("VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 30\nHEIGHT 20\n"
            "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 600\nDATA ascii\n")  # fmt: skip
    path = tmp_path / "depth.pcd"
    path.write_text(head + "".join(f"{x} {y} {z}\n" for x, y, z in points))
    return path


def stance(result: Result) -> dict[str, Any]:
    [line] = [json.loads(text) for text in result.stdout.splitlines()]
    [found] = line["stances"]
    return found


def test_depth_camera_files_are_seen_from_their_sensor(render: Callable[..., Result], organised: Path) -> None:
    result = render(organised, "--json")
    assert result.exit_code == 0, result.output
    found = stance(result)
    assert (found["up"], found["view_reason"]) == ("-Y", "from the sensor")
    assert 10 < found["elevation"] < 25
    assert "up -Y: as its depth camera stood; azimuth 0 from the file's front, elevation " in result.stderr


def test_given_and_fixed_elevations_override_the_sensors(
    render: Callable[..., Result], organised: Path, make_weights: Callable[..., Path], tmp_path: Path
) -> None:
    assert stance(render(organised, "--json", "--elevation", "50"))["elevation"] == 50
    fixed = make_weights(("color",), fixed_elevation=35.0)
    assert stance(render(organised, "--json", weights=fixed, output=tmp_path / "fixed"))["elevation"] == 35
    asked = render(organised, "--json", "--view", "40,60", output=tmp_path / "asked")
    assert (stance(asked)["azimuth"], stance(asked)["elevation"]) == (40, 60)
    turned = render(organised, "--json", "--view", "40,60", "--azimuth", "3", output=tmp_path / "b")
    assert (stance(turned)["azimuth"], stance(turned)["elevation"]) == (43, 60)
    result = render(organised, "--view", "40,60", weights=fixed, output=tmp_path / "no")
    assert result.exit_code == 2
    assert "know only 35 degrees, got 60" in result.stderr


def test_view_sensor_fails_for_files_without_a_sensor(
    render: Callable[..., Result], organised: Path, scans: Path
) -> None:
    result = render(organised, scans / "one.npy", "--view", "sensor")
    assert result.exit_code == 1
    lines = result.stderr.splitlines()
    assert [line.split(":")[0] for line in lines[:2]] == ["rendered", "failed"]
    assert "no sensor to look from" in lines[1]
    assert lines[2] == "1 rendered, 0 skipped, 1 failed"


def test_outliers_are_reported(render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray) -> None:
    np.save(tmp_path / "stray.npy", np.vstack([cloud, [[90.0, 0, 0]], [[0, 99.0, 0]]]))
    result = render(tmp_path / "stray.npy", "--json")
    assert stance(result)["outliers"] == 2
    assert "; 2 stray points left out of the frame" in result.stderr
    clipped = Image.open(tmp_path / "out" / "stray.png").tobytes()
    kept = render(tmp_path / "stray.npy", "--json", "--keep-outliers", "--overwrite")
    assert stance(kept)["outliers"] == 0
    assert "stray points" not in kept.stderr
    assert Image.open(tmp_path / "out" / "stray.png").tobytes() != clipped


def test_clouds_of_a_batch_file_share_one_line(
    render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray
) -> None:
    turned = (cloud - cloud.mean(0))[:, [1, 0, 2]]
    np.save(tmp_path / "many.npy", np.stack([cloud, cloud, turned]))
    result = render(tmp_path / "many.npy", "--json")
    [line] = [json.loads(text) for text in result.stdout.splitlines()]
    assert len(line["stances"]) == 3
    assert line["stances"][0] == line["stances"][1] != line["stances"][2]
    assert len(result.stderr.splitlines()) == 2
    assert "; its other clouds otherwise)" in result.stderr
