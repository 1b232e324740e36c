"""Colors of points on the command line: by the file's own, by fields and by classes, with their scale and legend."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from z2p_renderer.storage.images.image_files import read_record


@pytest.fixture
def series(tmp_path: Path, cloud: np.ndarray) -> Path:
    """Folder with two clouds whose points have colors, times (0 to 1, and to 2) and labels."""
    folder = tmp_path / "series"
    folder.mkdir()
    rgb = np.random.default_rng(2).integers(0, 256, cloud.shape)
    for name, scale in (("a", 1.0), ("b", 2.0)):
        times, labels = np.linspace(0, scale, len(cloud)), np.arange(len(cloud)) % 3 + scale
        np.savetxt(folder / f"{name}.csv", np.column_stack([cloud, rgb, times, labels]), delimiter=",",
                   header="x,y,z,r,g,b,time,label", comments="", fmt="%.6g")  # fmt: skip
    return folder


@pytest.fixture
def color(render: Callable[..., Result]) -> Callable[..., Result]:
    """Function that renders with shipped weights, which draw colors of points."""
    return lambda *words, **options: render(*words, weights="regular", **options)


def test_a_files_colors_are_drawn_unless_one_is_chosen(
    color: Callable[..., Result], series: Path, tmp_path: Path
) -> None:
    result = color(series / "a.csv")
    assert result.exit_code == 0 and "own colours (8-bit)" in result.stderr
    assert read_record(tmp_path / "out" / "a.png")["color_by"] == "rgb"
    for index, words in enumerate((("--color", "red"), ("--color-by", "none"))):
        output = tmp_path / f"{index}.png"
        assert "own colours" not in color(series / "a.csv", *words, output=output).stderr
        assert read_record(output).get("color_by", "none") == "none"


def test_a_series_has_one_scale_and_a_legend(color: Callable[..., Result], series: Path, tmp_path: Path) -> None:
    legend = tmp_path / "legend.svg"
    result = color(series, "--color-by", "time", "--colormap", "turbo", "--color-bar", "--legend", legend)
    assert result.exit_code == 0 and "one scale of colours for all clouds: time, 0.0" in result.stderr
    records = [read_record(tmp_path / "out" / f"{name}.png") for name in "ab"]
    assert records[0]["clim"] == records[1]["clim"] and records[0]["colormap"] == "turbo"
    assert "time" in legend.read_text() and f"wrote {legend}" in result.stderr
    with Image.open(tmp_path / "out" / "a.png") as picture:
        assert picture.width > picture.height == 32


def test_a_rerendered_picture_keeps_its_colors(
    color: Callable[..., Result], z2p: Callable[..., Result], series: Path, tmp_path: Path
) -> None:
    fig, again, other = (tmp_path / name for name in ("fig.png", "again.png", "other.png"))
    color(series / "a.csv", "--color-by", "time", "--clim", "0,3", "--classes", "1,2", "--relight", 0.5, output=fig)
    assert z2p("rerender", fig, "-o", again).exit_code == 0
    assert again.read_bytes() == fig.read_bytes()
    assert z2p("rerender", fig, "-o", other, "--color-by", "label", "--quiet").exit_code == 0
    record = read_record(other)
    assert (record["color_by"], record["classes"], record.get("clim")) == ("label", [1, 2], None)
    assert z2p("rerender", fig, "-o", other, "--color", "red", "--overwrite").exit_code == 0
    assert read_record(other).get("color_by", "none") == "none"


def test_other_colors_draw_a_named_picture_again(color: Callable[..., Result], series: Path, tmp_path: Path) -> None:
    fig, scan = tmp_path / "fig.png", series / "a.csv"
    color(scan, "--color-by", "time", output=fig)
    assert "1 skipped" in color(scan, "--color-by", "time", output=fig).stderr
    for words in (("label",), ("time", "--clim", "0,9"), ("time", "--relight", 0.5), ("time", "--color-bar"), ("rgb",)):
        assert "1 rendered" in color(scan, "--color-by", *words, output=fig).stderr


@pytest.mark.parametrize(("words", "message"), [
    (("--color-by", "tume"), "rgb, time, label, x, y, z, height, none, got 'tume' (did you mean time?)"),
    (("--color-by", "time", "--color", "red"), "--color-by and --color both choose the colour"),
    (("--color-by", "time", "--palette", "okabe-ito"), "--color-by and --palette both choose the colour"),
    (("--clim", "0,1"), "--clim is for a field's values"),
    (("--color-by", "time", "--clim", "1,0"), "expected LOW,HIGH as two finite numbers"),
    (("--color-by", "time", "--colormap", "virides"), "Did you mean viridis?"),
    (("--color-by", "time", "--legend", "legend.txt"), "expected a file named .svg"),
    (("--classes", "2;5"), "expected whole numbers joined by commas"),
    (("--classes", "77"), "its classes are 1, 2, 3"),
    (("--relight", "2"), "2.0 is not in the range 0<=x<=1"),
    (("--colourmap", "turbo"), "--colormap"),
])  # fmt: skip
def test_wrong_color_options_say_what_is_expected(
    color: Callable[..., Result], series: Path, words: tuple[str, ...], message: str
) -> None:
    result = color(series / "a.csv", *words)
    assert result.exit_code in (1, 2) and message in " ".join(result.stderr.split())


def test_weights_without_colors_refuse_a_field(
    render: Callable[..., Result], make_weights: Callable[..., Path], series: Path
) -> None:
    weights = make_weights(("light", "elevation"))
    assert "draw no colours of points" in render(series / "a.csv", "--color-by", "time", weights=weights).stderr
    assert render(series / "a.csv", weights=weights).exit_code == 0


def test_loops_are_colored_like_pictures(z2p: Callable[..., Result], series: Path, tmp_path: Path) -> None:
    loop = tmp_path / "loop.webp"
    result = z2p("animate", series / "a.csv", "-o", loop, "--frames", 2, "--resolution", 32, "--color-by", "label",
                 "--color-bar", "--fit", "tight")  # fmt: skip
    assert result.exit_code == 0 and "coloured by label, 3 classes" in result.stderr
    assert read_record(loop)["color_by"] == "label"


def test_info_lists_the_fields_of_a_scan(z2p: Callable[..., Result], series: Path) -> None:
    text = z2p("info", series / "a.csv").stdout
    assert "8-bit" in text and "0 to 1" in text and "3 classes (1: 134, 2: 133, 3: 133)" in text
    [cloud] = json.loads(z2p("info", series / "a.csv", "--json").stdout)["clouds"]
    assert cloud["points"] == 400 and list(cloud["fields"]) == ["rgb", "time", "label"]
    assert cloud["fields"]["label"]["classes"][0] == {"value": 1, "name": "", "points": 134}
