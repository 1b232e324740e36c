"""`z2p render`: lines and JSON for each file, options, and exit statuses."""

from __future__ import annotations

import json
import os
import pty
import re
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from z2p_core import registry
from z2p_core.coloring.options import ColorOptions


def pictures(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def lines(result: Result) -> list[dict[str, object]]:
    return [json.loads(line) for line in result.stdout.splitlines()]


def add_plugin(monkeypatch: pytest.MonkeyPatch, group: str, name: str, target: str) -> None:
    """Make the registry see one more entry point, for this test."""
    entries = {**registry._entries(group), name: (EntryPoint(name, target, f"z2p.{group}"),)}
    original = registry._entries
    monkeypatch.setattr(registry, "_entries", lambda asked: entries if asked == group else original(asked))


def test_a_folder_is_rendered_with_a_line_for_each_file(
    render: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    result = render(scans)
    assert result.exit_code == 0, result.output
    assert pictures(tmp_path / "out") == ["one.png", "two.png"]
    picture = Image.open(tmp_path / "out" / "one.png")
    assert (picture.mode, picture.size) == ("RGBA", (32, 32))
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert [line.split(":")[0] for line in lines[:2]] == ["rendered", "rendered"]
    assert all(re.search(r"; up \+[XYZ]: .*; azimuth -?\d+ from the file's front: ", line) for line in lines[:2])
    assert lines[2:] == ["2 rendered, 0 skipped, 0 failed"]


def test_a_bad_file_gets_one_line_and_the_rest_is_rendered(
    render: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    (scans / "a bad one.ply").write_bytes(b"not a ply at all\n\n")
    result = render(scans, "--json")
    assert result.exit_code == 1
    assert pictures(tmp_path / "out") == ["one.png", "two.png"]
    failures = [line for line in result.stderr.splitlines() if "a bad one" in line]
    assert len(failures) == 1
    assert failures[0].startswith(f"failed: {scans / 'a bad one.ply'}: ")
    assert failures[0].count("a bad one.ply") == 1
    assert len(result.stderr.splitlines()) == 4
    assert [line["status"] for line in lines(result)] == ["failed", "ok", "ok"]
    assert lines(result)[0]["error"] and lines(result)[1]["error"] is None


def test_json_lines_have_all_fields(
    render: Callable[..., Result], scans: Path, tmp_path: Path, cloud: np.ndarray
) -> None:
    broken_rows = cloud.copy()
    broken_rows[[3, 5, 8], 1] = np.nan
    broken_rows[9] = np.inf
    np.save(scans / "one.npy", broken_rows)
    result = render(scans / "one.npy", "--json", "--color", "1,0,0", "--up", "-y", "--view", "front",
                    "--azimuth", "-30")
    [line] = lines(result)
    assert line.pop("seconds") > 0
    settings = line.pop("settings")
    [stance] = line.pop("stances")
    picture = str(tmp_path / "out" / "one.png")
    assert line == {
        "input": str(scans / "one.npy"), "output": picture, "outputs": [picture], "status": "ok",
        "points": 396, "dropped": 4, "repeated": 0, "total": 400, "error": None, "note": "",
        "weights": ["tiny"], "colors": [""],
    }  # fmt: skip
    assert settings["controls"]["color"] == [1, 0, 0]
    assert (settings["up"], settings["azimuth"], settings["elevation"]) == ("-Y", -30, 20)
    assert (settings["resolution"], settings["background"]) == ([32, 32], "transparent")
    assert "4 not finite dropped" in result.stderr
    assert settings["view"] == "front"
    assert stance == {"up": "-Y", "up_reason": "as asked", "azimuth": -30, "elevation": 20,
                      "view_reason": "the front", "outliers": 0, "outside": 0, "background": 0, "hint": "",
                      "rounded": 0, "smooth": 0, "added": 0, "far": 0, "turned": -30}  # fmt: skip
    assert "; up -Y: as asked; azimuth -30 from the file's front: the front, turned on by -30)" in result.stderr


def test_quiet_reports_failures_only(render: Callable[..., Result], scans: Path) -> None:
    assert render(scans, "--quiet").output == ""
    (scans / "bad.ply").write_bytes(b"no")
    result = render(scans, "--quiet")
    assert result.exit_code == 1
    assert [line.split(":")[0] for line in result.stderr.splitlines()] == ["failed"]


def test_the_number_of_jobs_does_not_change_pictures(
    render: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    render(scans, output=tmp_path / "alone")
    result = render(scans, "--jobs", 2, output=tmp_path / "pair")
    assert result.exit_code == 0, result.output
    assert len(pictures(tmp_path / "alone")) == 2
    for name in pictures(tmp_path / "alone"):
        first, second = (np.asarray(Image.open(tmp_path / run / name)).astype(int) for run in ("alone", "pair"))
        assert np.abs(first - second).max() <= 1  # sums are split differently among threads


def test_a_control_changes_the_picture(render: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    asked = {"plain": (), "red": ("--color", "red"), "lit": ("--light", "3.6,60,50"), "high": ("--elevation", "60"),
             "turned": ("--azimuth", "90"), "other-up": ("--up", "-X")}  # fmt: skip
    for name, words in asked.items():
        assert render(scans / "one.npy", *words, output=tmp_path / name).exit_code == 0
    made = {path.parent.name: Image.open(path).tobytes() for path in tmp_path.glob("*/one.png")}
    assert len(made) == 6
    assert len(set(made.values())) == 6


def test_white_background_is_the_transparent_picture_on_white(
    render: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    render(scans / "one.npy", output=tmp_path / "clear")
    assert render(scans / "one.npy", "--background", "white", output=tmp_path / "white").exit_code == 0
    clear = np.asarray(Image.open(tmp_path / "clear" / "one.png")).astype(float) / 255
    white = np.asarray(Image.open(tmp_path / "white" / "one.png")).astype(float) / 255
    assert clear[..., 3].min() < 0.9
    assert white.shape == (32, 32, 3)
    assert np.abs(clear[..., :3] * clear[..., 3:] + 1 - clear[..., 3:] - white).max() < 1.01 / 255


@pytest.mark.parametrize(("text", "size"), [("64,32", (64, 32)), ("48X96", (48, 96)), ("33", (33, 33))])
def test_resolution_takes_one_side_or_two(
    render: Callable[..., Result], scans: Path, tmp_path: Path, text: str, size: object
) -> None:
    assert render(scans / "one.npy", "--resolution", text).exit_code == 0
    assert Image.open(tmp_path / "out" / "one.png").size == size


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--resolution", "31"), "32 to 4096"),
        (("--resolution", "4096", "--supersample", "4"), "at most 8192"),
        (("--output", "a" * 300 + ".png"), "at most 255 bytes, got one of 304"),
        (("--resolution", "99999999999"), "32 to 4096"),
        (("--resolution", "64,"), "32 to 4096"),
        (("--background", "nocolour"), "CSS colour name"),
        (("--background", "#ff000080"), "opaque"),
        (("--color", "nocolour"), "expected a CSS colour name"),
        (("--color", "2,0,0"), "red is 2"),
        (("--light", "3.6,-40"), "radius,azimuth,elevation"),
        (("--elevation", "85"), "expected 0 to 80"),
        (("--elevation", "nan"), "expected 0 to 80"),
        (("--azimuth", "nan"), "--azimuth"),
        (("--up", "up"), "+Z"),
        (("--view", "side"), "AZ,EL"),
        (("--view", "30,20,10"), "AZ,EL"),
        (("--view", "nan"), "AZ,EL"),
        (("--margin", "0.5"), "percent as in 10%"),
        (("--margin", "inf"), "percent as in 10%"),
        (("--view", "30,-1"), "AZ,EL"),
        (("--view", "30,85"), "EL from 0 to 80, got '30,85'"),
        (("--view", "30,20", "--elevation", "20"), "--view AZ,EL and --elevation both"),
        (("--load-camera", "cam.json", "--view", "auto"), "--load-camera and --view both"),
        (("--load-camera", "cam.json", "--up", "+Z"), "--load-camera and --up both"),
        (("--cut-top", "nan"), "finite number, got 'nan'"),
        (("--cut-top", "100"), "range 0<=x<100"),
        (("--smooth", "0.4"), "expected auto, or a radius from 0 to 0.3, got '0.4'"),
        (("--save-camera", "folder/"), "a file's name"),
        (("--output", ""), "is the variable empty"),
        (("--output", "-"), "standard output"),
        (("",), "is the variable empty"),
        (("--jobs", "0"), "--jobs"),
        (("--metallic", "0.5"), "they carry: color, light, elevation"),
        (("--weights", "nosuch"), "unknown weights 'nosuch'"),
        (("--nosuch", "1"), "--nosuch"),
    ],
)
def test_wrong_usage_exits_with_2(
    render: Callable[..., Result], scans: Path, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    result = render(scans, *words)
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.stderr.split())
    assert "Traceback" not in result.output
    assert not (tmp_path / "out").exists()


def test_weights_without_elevation_accept_only_their_own(
    render: Callable[..., Result], make_weights: Callable[..., Path], scans: Path
) -> None:
    fixed = make_weights(("color",), fixed_elevation=35.0)
    result = render(scans, "--json", "--elevation", "35", weights=fixed)
    assert result.exit_code == 0, result.output
    assert lines(result)[0]["settings"]["elevation"] == 35
    assert "elevation" not in lines(result)[0]["settings"]["controls"]
    result = render(scans, "--elevation", "20", weights=fixed)
    assert result.exit_code == 2
    assert "know only 35 degrees, got 20" in result.stderr


def test_a_damaged_weights_file_is_refused(render: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    (tmp_path / "pickle.pt").write_bytes(b"\x80\x02cos\nsystem\n.")
    result = render(scans, weights=tmp_path / "pickle.pt")
    assert result.exit_code == 2
    assert result.stderr.startswith("Error: ")
    assert "pickle" in result.stderr


def test_a_broken_control_fails_only_when_it_is_used(
    z2p: Callable[..., Result], render: Callable[..., Result], scans: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_plugin(monkeypatch, "controls", "torn", "no_such_module_anywhere:Torn")
    assert render(scans).exit_code == 0
    assert "fails to load" in z2p("run-inference", "--help").output
    result = render(scans, "--torn", "0.5")
    assert result.exit_code == 2
    assert "no_such_module_anywhere" in result.stderr
    listed = json.loads(z2p("plugins", "--json").stdout)
    [torn] = [row for row in listed if row["name"] == "torn"]
    assert torn["status"] == "broken"
    assert all(row["status"] == "ok" for row in listed if row["name"] != "torn")
    table = z2p("plugins")
    assert table.exit_code == 0
    assert "broken: control 'torn'" in table.output


def test_a_control_named_like_an_option_gets_a_prefix(
    z2p: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    add_plugin(monkeypatch, "controls", "output", "z2p_renderer.plugins.controls.metallic:Metallic")
    assert "--control-output" in z2p("run-inference", "--help").output


def test_installed_controls_are_options_with_their_help(z2p: Callable[..., Result]) -> None:
    text = " ".join(z2p("run-inference", "--help").output.split())
    names = registry.names("controls")
    assert {"color", "light", "elevation", "metallic", "roughness"} <= set(names)
    for name in ("color", "light", "elevation", "metallic", "roughness"):
        slider = registry.load("controls", name).slider
        assert f"--{name} {slider.metavar}" in text
        assert slider.help[:20] in text


@pytest.mark.slow
def test_the_command_runs_in_a_process_of_its_own(scans: Path, tiny_weights: Path, tmp_path: Path) -> None:
    (scans / "bad.las").write_bytes(b"LASF but no more")
    done = subprocess.run(
        [sys.executable, "-m", "z2p_renderer.pipeline.cli", "run-inference", "scans", "--output", "out", "--json",
         "--weights", tiny_weights, "--resolution", "64,32"],
        cwd=tmp_path, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert [json.loads(line)["status"] for line in done.stdout.splitlines()] == ["failed", "ok", "ok"]
    assert len(done.stderr.splitlines()) == 4, done.stderr
    assert "\r" not in done.stderr
    assert pictures(tmp_path / "out") == ["one.png", "two.png"]


@pytest.mark.slow
def test_on_a_terminal_each_file_has_a_line(scans: Path, tiny_weights: Path, tmp_path: Path) -> None:
    """Which way was taken for up is never guessed silently, bar or no bar."""
    ours, theirs = pty.openpty()
    words = ["run-inference", scans, "-o", tmp_path / "out", "--weights", tiny_weights, "--resolution", "32"]
    subprocess.run([sys.executable, "-m", "z2p_renderer.pipeline.cli", *words], stderr=theirs, check=True,
                   env={**os.environ, "OMP_NUM_THREADS": "1"})  # fmt: skip
    os.close(theirs)
    shown = os.read(ours, 100_000).decode()
    os.close(ours)
    assert shown.count("; up +") == 2 and "2 rendered, 0 skipped, 0 failed" in shown


def test_ctrl_c_has_an_exit_status_of_its_own(
    render: Callable[..., Result], scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from z2p_renderer.pipeline.batch import render_files as batch

    original = batch.read_scans

    def read(path: Path, columns: None, options: ColorOptions, max_rows: int) -> list[batch.Scan]:
        if path.name == "two.xyz":
            raise KeyboardInterrupt
        return original(path, columns, options, max_rows)

    monkeypatch.setattr(batch, "read_scans", read)
    result = render(scans)
    assert result.exit_code == 130
    assert result.stderr.endswith("Interrupted.\n")
    assert pictures(tmp_path / "out") == ["one.png"]
