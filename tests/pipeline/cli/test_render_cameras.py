"""`z2p render` and `z2p animate` with cameras in the data's units, and with passes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from z2p_core.pinhole import LookAt, camera_from_json, look_at_camera
from z2p_renderer.storage.images.image_files import read_record
from z2p_renderer.storage.poses.read_poses import write_poses

FROM = ("--look-from", "6,-2,7")


@pytest.fixture
def scan(scans: Path) -> Path:
    return scans / "one.npy"


@pytest.fixture
def ring(tmp_path: Path) -> Path:
    """File of three cameras around the cloud, with pictures of 64 x 64 pixels."""
    eyes = ((9.0, 4.0, 7.0), (3.0, -2.0, 7.0), (-3.0, 4.0, 7.0))
    write_poses([look_at_camera(LookAt(eye), (64, 64), (3, 4, 5), (0, 0, 1)) for eye in eyes], tmp_path / "ring.json")
    return tmp_path / "ring.json"


def test_a_camera_looks_from_a_place(render: Callable[..., Result], scan: Path, tmp_path: Path) -> None:
    words = ("--look-at", "3,4,5.2", "--fov", "30", "--up", "Z", "--save-camera", tmp_path / "c.json")
    result = render(scan, *FROM, *words)
    assert result.exit_code == 0, result.output
    assert "as the given camera sees it; drawn without the network, as the cloud is tiny" in result.stderr
    record = read_record(tmp_path / "out" / "one.png")
    camera = camera_from_json(record["pinhole"])
    np.testing.assert_allclose(camera.position, [6, -2, 7], atol=1e-9)
    assert camera_from_json(json.loads((tmp_path / "c.json").read_text())) == camera
    assert record["without_network"] == "the cloud is tiny in its picture"
    again = render(scan, "--load-camera", tmp_path / "c.json", "--up", "Z", output=tmp_path / "again")
    assert again.exit_code == 0, again.output
    pictures = [np.asarray(Image.open(tmp_path / folder / "one.png")) for folder in ("out", "again")]
    np.testing.assert_array_equal(*pictures)


def test_there_is_a_picture_of_each_pose(render: Callable[..., Result], scan: Path, ring: Path, tmp_path: Path) -> None:
    result = render(scan, "--cameras", ring, "--up", "Z")
    assert result.exit_code == 0, result.output
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["one_000.png", "one_001.png", "one_002.png"]
    assert Image.open(tmp_path / "out" / "one_001.png").size == (32, 32)
    assert render(scan, "--cameras", ring, output=tmp_path / "one.png").exit_code == 2
    assert "3 skipped" in render(scan, "--cameras", ring, "--up", "Z").stderr


def test_the_file_of_several_poses_is_read_once(
    render: Callable[..., Result], scan: Path, ring: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from z2p_renderer.pipeline.batch import render_files

    reads, read_scans = [], render_files.read_scans
    monkeypatch.setattr(render_files, "read_scans", lambda path, *rest: reads.append(path) or read_scans(path, *rest))
    assert render(scan, "--cameras", ring, "--up", "Z").exit_code == 0
    assert reads == [scan]


def test_a_path_of_cameras_is_a_film(
    z2p: Callable[..., Result], tiny_weights: Path, scan: Path, ring: Path, tmp_path: Path
) -> None:
    words = ("--weights", tiny_weights, "--resolution", 64, "--up", "Z", "--output", tmp_path / "film.webp")
    result = z2p("animate", scan, "--cameras", ring, *words)
    assert result.exit_code == 0, result.output
    with Image.open(tmp_path / "film.webp") as film:
        assert (film.n_frames, film.size) == (3, (64, 64))
    assert read_record(tmp_path / "film.webp")["motion"]["kind"] == "path"
    assert "skipped" in z2p("animate", scan, "--cameras", ring, *words).stderr


def test_passes_lie_beside_the_picture(render: Callable[..., Result], scan: Path, tmp_path: Path) -> None:
    result = render(scan, "--passes", "depth,position", "--view", "front", "--up", "Z")
    assert result.exit_code == 0, result.output
    depth, position = (np.load(tmp_path / "out" / f"one_{name}.npy") for name in ("depth", "position"))
    camera = camera_from_json(json.loads((tmp_path / "out" / "one_camera.json").read_text()))
    seen = np.isfinite(depth)
    np.testing.assert_allclose(camera.project(position[seen])[1], depth[seen], rtol=1e-5)
    assert "skipped" in render(scan, "--passes", "depth,position", "--view", "front", "--up", "Z").stderr
    (tmp_path / "out" / "one_depth.npy").unlink()
    assert "1 rendered" in render(scan, "--passes", "depth,position", "--view", "front", "--up", "Z").stderr


def test_an_orthographic_picture_is_to_scale(
    z2p: Callable[..., Result], tiny_weights: Path, scan: Path, tmp_path: Path
) -> None:
    result = z2p("render", scan, "-o", tmp_path / "plan.png", "--weights", tiny_weights, "--up", "Z",
                 "--orthographic", "25.4", "--dpi", "50", "--look-from", "3,4,50", "--look-at", "3,4,5")  # fmt: skip
    assert result.exit_code == 0, result.output
    assert read_record(tmp_path / "plan.png")["pinhole"]["model"] == "orthographic"
    width, height = Image.open(tmp_path / "plan.png").size  # the ellipsoid is 2 wide and 1.2 deep
    assert width == pytest.approx(2 * 50 * 1.1, abs=4) and height == pytest.approx(1.2 * 50 + 10, abs=4)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--look-at", "1,2,3"), "expected --look-from"), ((*FROM, "--view", "30"), "--look-from and --view"),
        ((*FROM, "--margin", "0.1"), "leave one out"), ((*FROM, "--elevation", "30"), "camera and elevation"),
        ((*FROM, "--orthographic", "3", "--fov", "30"), "--fov and --orthographic"), ((*FROM, "--axes"), "--axes"),
        ((*FROM, "--same-frame"), "--same-frame and a camera"), (("--passes", "dept"), "'dept'"),
        ((*FROM, "--load-camera", "x.json"), "both choose the camera"),
        (("--cameras", "none.json"), "none.json: No such file"),
    ],
)  # fmt: skip
def test_options_that_contradict_each_other_are_refused(
    render: Callable[..., Result], scan: Path, words: tuple[str, ...], message: str
) -> None:
    result = render(scan, *words)
    assert result.exit_code == 2 and message in result.stderr
