"""Existing pictures are kept if they show the cloud, drawn again if it changed, and never replaced if not ours."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from z2p_core.placement.viewpoint import Viewpoint, viewpoint_from_json
from z2p_renderer.pipeline.batch.render_files import Outcome, render_files
from z2p_renderer.pipeline.batch.tasks import Task
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.inference.weight_selection import AutoRenderer
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.storage.images.image_files import read_record

LOOK = Look(width=32, height=32)


@pytest.fixture(scope="module")
def renderer(tiny_weights: Path) -> Renderer:
    return Renderer(tiny_weights)


@pytest.fixture
def scan(tmp_path: Path, cloud: np.ndarray) -> Path:
    (tmp_path / "x").mkdir()
    np.save(tmp_path / "x" / "a.npy", cloud)
    return tmp_path / "x" / "a.npy"


def drawn(renderer: Renderer, scan: Path, output: Path, look: Look = LOOK, **more: object) -> Outcome:
    [outcome] = render_files([Task(scan, output, **more)], renderer, look)  # type: ignore[arg-type]
    return outcome


def test_a_picture_of_the_same_cloud_is_kept(renderer: Renderer, scan: Path, tmp_path: Path) -> None:
    output = tmp_path / "a.png"
    assert drawn(renderer, scan, output).status == "ok"
    before = output.read_bytes()
    again = drawn(renderer, scan, output)
    assert (again.status, again.kept) == ("skipped", "") and output.read_bytes() == before
    moved = shutil.copy(scan, tmp_path / "elsewhere.npy")
    assert drawn(renderer, Path(moved), output).status == "skipped", "its content tells it"


def test_a_picture_of_a_changed_cloud_is_drawn_again(
    renderer: Renderer, scan: Path, tmp_path: Path, cloud: np.ndarray
) -> None:
    drawn(renderer, scan, tmp_path / "a.png")
    np.save(scan, cloud * (1.0, 2.0, 0.5))
    fresh = drawn(renderer, scan, tmp_path / "fresh.png")
    assert drawn(renderer, scan, tmp_path / "a.png").status == "ok" == fresh.status
    assert np.array_equal(Image.open(tmp_path / "a.png"), Image.open(tmp_path / "fresh.png"))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp", ".tif"])
def test_a_picture_of_another_cloud_is_not_replaced(
    renderer: Renderer, scan: Path, tmp_path: Path, cloud: np.ndarray, suffix: str
) -> None:
    output, other = tmp_path / f"a{suffix}", tmp_path / "y" / "a.npy"
    drawn(renderer, scan, output)
    before = output.read_bytes()
    other.parent.mkdir()
    np.save(other, cloud * (1.0, 2.0, 0.5))
    outcome = drawn(renderer, other, output)
    assert outcome.status == "failed" and outcome.error is not None
    assert f"shows another cloud, {scan}" in outcome.error and "--overwrite" in outcome.error
    assert output.read_bytes() == before


def test_the_clouds_of_one_file_are_distinguished(
    renderer: Renderer, tmp_path: Path, cloud: np.ndarray
) -> None:
    np.save(tmp_path / "a.npy", np.stack([cloud, cloud[:, ::-1]]))
    drawn(renderer, tmp_path / "a.npy", tmp_path / "a.png")
    shutil.copy(tmp_path / "a_000.png", tmp_path / "a_001.png")
    assert drawn(renderer, tmp_path / "a.npy", tmp_path / "a.png").status == "ok"
    assert read_record(tmp_path / "a_001.png")["input"]["cloud"] == 1


@pytest.mark.parametrize(
    ("look", "message"),
    [
        (replace(LOOK, values={"color": (0.1, 0.2, 0.3)}), "with another color"),
        (replace(LOOK, width=48), "with another resolution"),
        (replace(LOOK, placement_options=PlacementOptions(up="-X", view=30.0)), "with another up and another view"),
        (replace(LOOK, placement_options=PlacementOptions(keep_outliers=True)), "with another keep-outliers"),
        (replace(LOOK, placement_options=PlacementOptions(azimuth=90.0)), "with another azimuth"),
        (replace(LOOK, placement_options=PlacementOptions(cut_top=10.0, smooth=0.1)),
         "with another cut-top and another smooth"),
        (replace(LOOK, background=(1.0, 1.0, 1.0), tight=True), "with another background and another fit"),
        (replace(LOOK, placement_options=PlacementOptions(
            viewpoint=Viewpoint((0.0, 0.0, 0.0), 9.0, tuple(map(tuple, np.eye(3))), 20.0))),
         "with another camera"),
    ],
)  # fmt: skip
def test_different_settings_of_a_kept_picture_are_named(
    renderer: Renderer, scan: Path, tmp_path: Path, look: Look, message: str
) -> None:
    output = tmp_path / "a.png"
    drawn(renderer, scan, output)
    before = output.read_bytes()
    outcome = drawn(renderer, scan, output, look)
    assert (outcome.status, outcome.kept) == ("skipped", message) and output.read_bytes() == before
    output.unlink()
    drawn(renderer, scan, output, look)
    assert drawn(renderer, scan, output, look).kept == "", "once it is drawn so there is nothing to say"


def test_a_camera_turned_about_the_cloud_is_another_camera(
    renderer: Renderer, scan: Path, tmp_path: Path
) -> None:
    output = tmp_path / "a.png"
    drawn(renderer, scan, output)
    same = viewpoint_from_json(read_record(output)["camera"])
    turned = replace(same, rotation=tuple(same.rotation[row] for row in (1, 2, 0)))
    notes = {side: drawn(renderer, scan, output, replace(LOOK, placement_options=PlacementOptions(viewpoint=side))).kept
            for side in (same, turned)}  # fmt: skip
    assert notes == {same: "", turned: "with another camera"}


def test_kept_pictures_of_a_series_name_camera_and_colour(
    render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray
) -> None:
    folder = tmp_path / "series"
    folder.mkdir()
    np.save(folder / "b.npy", cloud)
    words = (folder, "--same-frame", "--palette", "okabe-ito", "--json")
    assert render(*words).exit_code == 0
    np.save(folder / "a.npy", 3 * cloud + 1)
    result = render(*words)
    assert [json.loads(line)["status"] for line in result.stdout.splitlines()] == ["ok", "skipped"]
    assert "is there already, with another color and another camera; --overwrite" in result.stderr


def test_json_lists_existing_pictures(
    render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray
) -> None:
    np.save(tmp_path / "a.npy", np.stack([cloud, np.full_like(cloud, np.nan)]))
    line = json.loads(render(tmp_path / "a.npy", "--json").stdout)
    assert line["status"] == "failed" and [Path(name).name for name in line["outputs"]] == ["a_000.png"]


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_a_file_that_is_no_picture_is_not_replaced(
    render: Callable[..., Result], scans: Path, tmp_path: Path, suffix: str
) -> None:
    first, second = (tmp_path / "out" / f"{name}{suffix}" for name in ("one", "two"))
    words = (scans, "--format", {".jpg": "jpeg"}.get(suffix, suffix[1:]))
    assert render(*words).exit_code == 0
    whole, cut = first.read_bytes(), second.read_bytes()[:-40]
    first.write_bytes(b"")
    second.write_bytes(cut)
    result = render(*words, "--gallery", "--sheet", "2x1")
    assert result.exit_code == 1 and first.read_bytes() == whole and second.read_bytes() == cut
    assert f"{second} is there already, but is no picture that can be read" in result.stderr
    assert (tmp_path / "out" / "gallery.html").read_text().count("<figure ") == 1  # of what can be read


def test_other_weights_are_named_unless_chosen_by_the_cloud(
    renderer: Renderer, make_weights: Callable[..., Path], scan: Path, tmp_path: Path
) -> None:
    output = tmp_path / "a.png"
    assert drawn(renderer, scan, output).status == "ok"
    assert drawn(Renderer(make_weights(cropped=True)), scan, output).kept == "with another choice of weights"
    assert drawn(AutoRenderer(), scan, output).kept == "with another choice of weights", "z2p was to choose them"
    by_choice = tmp_path / "b.png"
    assert drawn(AutoRenderer(), scan, by_choice).status == "ok"
    assert drawn(AutoRenderer(), scan, by_choice).kept == ""


@pytest.mark.parametrize(
    "other", [{"width": 48}, {"values": {"color": (1.0, 0.0, 0.0)}}, {"background": (1.0, 1.0, 1.0)}, {"tight": True},
              {"margin": 0.2}, {"supersample": 2}, {"placement_options": PlacementOptions("+Y")},
              {"placement_options": PlacementOptions(azimuth=30.0)}],
    ids=str,
)  # fmt: skip
def test_a_named_picture_is_drawn_again_for_changed_settings(
    renderer: Renderer, scan: Path, tmp_path: Path, other: dict[str, Any]
) -> None:
    output, changed = tmp_path / "a.png", replace(LOOK, **other)
    for look, status in ((LOOK, "ok"), (LOOK, "skipped"), (changed, "ok"), (changed, "skipped"), (LOOK, "ok")):
        assert drawn(renderer, scan, output, look, single=True).status == status
    outcome = drawn(renderer, scan, output, changed)
    assert outcome.status == "skipped" and outcome.kept.startswith("with another "), "one of a folder stays"


def test_a_named_picture_is_drawn_again_without_its_camera(
    renderer: Renderer, scan: Path, tmp_path: Path
) -> None:
    output = tmp_path / "a.png"
    drawn(renderer, scan, output)
    camera = viewpoint_from_json(read_record(output)["camera"])
    loaded = replace(LOOK, placement_options=PlacementOptions(viewpoint=replace(camera, radius=2 * camera.radius)))
    for look, status in ((loaded, "ok"), (loaded, "skipped"), (LOOK, "ok"), (LOOK, "skipped")):
        assert drawn(renderer, scan, output, look, single=True).status == status


def test_a_picture_of_another_program_is_kept_and_named(
    render: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    mine = tmp_path / "out" / "one.png"
    mine.parent.mkdir()
    Image.new("RGB", (9, 9), "red").save(mine)
    before = mine.read_bytes()
    result = render(scans)
    assert result.exit_code == 0 and mine.read_bytes() == before
    assert f"{mine} is there already, without a record of z2p; --overwrite" in result.stderr


def test_an_existing_loop_is_treated_like_a_picture(
    z2p: Callable[..., Result], tiny_weights: Path, scans: Path, tmp_path: Path, cloud: np.ndarray
) -> None:
    def animate(*words: object) -> Result:
        return z2p("animate", scans / "one.npy", "-o", loop, "--weights", tiny_weights, "--resolution", 32, *words)

    for suffix in (".webp", ".gif"):
        loop = tmp_path / f"one{suffix}"
        np.save(scans / "one.npy", cloud)
        assert animate("--frames", 3).exit_code == 0
        before = loop.read_bytes()
        assert f"{loop} is there already; " in animate("--frames", 3).stderr
        other = z2p("animate", scans / "one.npy", "-o", tmp_path, "--format", suffix[1:], "--weights", tiny_weights,
                    "--resolution", 32, "--frames", 4, "--motion", "light", "--color", "red")  # fmt: skip
        assert "with another color and another motion and another frames; --overwrite" in other.stderr
        assert z2p("run-inference", scans / "two.xyz", "-o", tmp_path / "still.webp", "--weights", tiny_weights,
                   "--resolution", 32, "--overwrite").exit_code == 0  # fmt: skip
        wrong = z2p("animate", scans / "one.npy", "-o", tmp_path / "still.webp", "--weights", tiny_weights)
        assert wrong.exit_code == 1 and "shows another cloud" in wrong.stderr
        assert loop.read_bytes() == before
        np.save(scans / "one.npy", cloud * (1.0, 2.0, 0.5))
        assert animate("--frames", 3).exit_code == 0 and loop.read_bytes() != before
