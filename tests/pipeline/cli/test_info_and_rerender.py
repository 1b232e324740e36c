"""`z2p info` shows a picture's record; `z2p rerender` draws the same picture with only the given changes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from z2p_renderer.storage.images.image_files import read_record, write_picture


@pytest.fixture
def figure(render: Callable[..., Result], scans: Path, tmp_path: Path) -> Path:
    """A picture of one.npy in blue, turned by 30 degrees."""
    result = render(scans / "one.npy", "--color", "blue", "--azimuth", 30, "--background", "white")
    assert result.exit_code == 0, result.output
    return tmp_path / "out" / "one.png"


@pytest.fixture
def rerender(z2p: Callable[..., Result], tiny_weights: Path) -> Callable[..., Result]:
    return lambda *words: z2p("rerender", "--weights", tiny_weights, *words)


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


def test_rerender_without_changes_gives_the_same_file(rerender: Callable[..., Result], figure: Path) -> None:
    result = rerender(figure)
    assert (result.exit_code, result.stderr) == (0, f"rendered: {figure} -> {figure.with_name('one_2.png')}\n")
    assert figure.with_name("one_2.png").read_bytes() == figure.read_bytes()


@pytest.mark.parametrize(
    ("words", "changed"),
    [
        (("--color", "teal"), {"color": [0, 128 / 255, 128 / 255]}),
        (("--light", "3.5,-40,50"), {"light": [3.5, -40, 50]}),
        (("--elevation", "60"), {"elevation": [60]}),
    ],
)
def test_rerender_changes_only_the_given_settings(
    rerender: Callable[..., Result], figure: Path, tmp_path: Path, words: tuple[str, ...], changed: dict[str, Any]
) -> None:
    out = tmp_path / "new.png"
    assert rerender(figure, "-o", out, *words).exit_code == 0
    before, after = read_record(figure), read_record(out)
    assert after["controls"] == {**before["controls"], **changed}
    expected = {**before, "controls": after["controls"], "camera": after["camera"], "input": after["input"]}
    assert after == expected
    assert not np.array_equal(pixels(out), pixels(figure))
    if "elevation" not in changed:
        assert after["camera"] == before["camera"]


def test_a_changed_figure_equals_a_new_render(
    rerender: Callable[..., Result], render: Callable[..., Result], scans: Path, figure: Path, tmp_path: Path
) -> None:
    assert rerender(figure, "-o", tmp_path / "a.png", "--color", "red", "--resolution", "48,40", "--background",
                    "transparent", "--supersample", 2, "--azimuth", 15).exit_code == 0  # fmt: skip
    render(scans / "one.npy", "--color", "red", "--azimuth", 45, "--resolution", "48,40", "--supersample", 2,
           output=tmp_path / "b.png")  # fmt: skip
    assert np.abs(pixels(tmp_path / "a.png").astype(int) - pixels(tmp_path / "b.png")).max() <= 2  # angles add up


def test_rerender_keeps_the_smoothing_unless_it_is_given(
    rerender: Callable[..., Result],
    render: Callable[..., Result],
    z2p: Callable[..., Result],
    scans: Path,
    tmp_path: Path,
) -> None:
    rng, points = np.random.default_rng(5), np.random.default_rng(6).normal(size=(4000, 3))
    points *= (1 + 0.03 * rng.normal(size=(4000, 1))) / np.linalg.norm(points, axis=1, keepdims=True)
    np.save(scans / "noisy.npy", points)
    figures = {smooth: tmp_path / f"{smooth}.png" for smooth in ("0", "0.3")}
    for smooth, path in figures.items():
        assert render(scans / "noisy.npy", "--smooth", smooth, output=path).exit_code == 0
        assert rerender(path, "-o", tmp_path / "again.png", "--overwrite").exit_code == 0
        assert (tmp_path / "again.png").read_bytes() == path.read_bytes()
    assert not np.array_equal(pixels(figures["0"]), pixels(figures["0.3"]))
    assert "smooth      over 0.3 of the frame's radius" in z2p("info", figures["0.3"]).stdout
    assert rerender(figures["0"], "-o", tmp_path / "other.png", "--smooth", 0.3).exit_code == 0
    assert (tmp_path / "other.png").read_bytes() == figures["0.3"].read_bytes()


def test_info_shows_the_record(z2p: Callable[..., Result], figure: Path, tmp_path: Path) -> None:
    result = z2p("info", figure)
    assert result.exit_code == 0
    for words in ("one.npy", "color       0, 0, 1", "azimuth", "weights     tiny", "32 x 32"):
        assert words in result.stdout
    record = json.loads(z2p("info", figure, "--json").stdout)
    assert record.pop("figure") == str(figure)
    assert record == read_record(figure)
    Image.new("RGB", (40, 40)).save(tmp_path / "plain.png")
    mixed = z2p("info", tmp_path / "plain.png", figure)
    assert mixed.exit_code == 1
    assert "holds no record" in mixed.stderr and "one.npy" in mixed.stdout


def test_a_moved_scan_is_found_and_a_changed_one_refused(
    rerender: Callable[..., Result], scans: Path, figure: Path, tmp_path: Path
) -> None:
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    shutil.copy(figure, moved / "fig.png")
    shutil.copy(scans / "one.npy", moved / "one.npy")
    (scans / "one.npy").rename(tmp_path / "kept.npy")
    assert rerender(moved / "fig.png").exit_code == 0  # its scan lies beside it
    gone = rerender(figure)
    assert gone.exit_code == 2 and "one.npy is not to be found" in gone.stderr and "--input" in gone.stderr
    assert rerender(figure, "--input", tmp_path / "kept.npy").exit_code == 0
    other = rerender(figure, "--input", scans / "two.xyz", "--overwrite")
    assert other.exit_code == 2 and "is not the scan" in other.stderr
    np.save(scans / "one.npy", np.random.default_rng(9).normal(size=(50, 3)))
    changed = rerender(figure, "--overwrite")
    assert changed.exit_code == 2 and "has changed since" in changed.stderr


def test_pictures_that_cannot_be_drawn_again_are_refused(
    z2p: Callable[..., Result],
    rerender: Callable[..., Result],
    figure: Path,
    tiny_weights: Path,
    cloud: np.ndarray,
    tmp_path: Path,
) -> None:
    import z2p_core

    own = z2p("rerender", figure)
    assert own.exit_code == 2 and "weights that z2p does not ship, 'tiny'" in own.stderr
    from_array = z2p_core.render(cloud, weights=tiny_weights, size=40).save(tmp_path / "array.png")
    result = rerender(from_array)
    assert result.exit_code == 2 and "from an array in Python" in result.stderr
    sheet = z2p_core.render([cloud, cloud * 2], weights=tiny_weights, size=40).save(tmp_path / "sheet.png")
    assert "a sheet of 2 clouds" in rerender(sheet).stderr and not (tmp_path / "sheet_2.png").exists()
    assert rerender(figure, "--metallic", "0.5").exit_code == 2
    assert rerender(figure).exit_code == 0
    again = rerender(figure)
    assert again.exit_code == 2 and "--overwrite" in again.stderr
    (tmp_path / "bad.png").write_bytes(b"no")
    assert rerender(tmp_path / "bad.png").exit_code == 2


def test_missing_controls_and_lost_transparency_are_noted(
    render: Callable[..., Result],
    rerender: Callable[..., Result],
    make_weights: Callable[..., Path],
    scans: Path,
    tmp_path: Path,
) -> None:
    shiny = make_weights(controls=("color", "light", "elevation", "metallic"))
    assert render(scans / "one.npy", "--weights", shiny, "--metallic", 1).exit_code == 0
    result = rerender(tmp_path / "out" / "one.png", "-o", tmp_path / "dull.jpg")
    assert result.exit_code == 0 and "the weights" in result.stderr and "have no metallic" in result.stderr
    assert "JPEG has no soft transparency" in result.stderr
    for words in (("-o", tmp_path / "a.png"), ("-o", tmp_path / "a.jpg", "--background", "white", "--quiet")):
        assert "transparency" not in rerender(tmp_path / "out" / "one.png", *words).stderr


def test_info_shows_cut_top_and_kept_outliers(
    render: Callable[..., Result], z2p: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    assert render(scans / "one.npy", "--cut-top", 20, "--keep-outliers", "--gallery").exit_code == 0
    words = " ".join(z2p("info", tmp_path / "out" / "one.png").stdout.split())
    assert "cut off 20 % of the height" in words and "kept outliers" in words
    assert "20 % of the height" in (tmp_path / "out" / "gallery.html").read_text()
    assert render(scans / "one.npy", "--overwrite").exit_code == 0
    assert "cut off" not in z2p("info", tmp_path / "out" / "one.png").stdout


def test_rerender_draws_the_same_cloud_of_a_batch_file(
    render: Callable[..., Result], rerender: Callable[..., Result], cloud: np.ndarray, tmp_path: Path
) -> None:
    np.save(tmp_path / "many.npy", np.stack([cloud, cloud[:, ::-1], cloud * [1, 2, 3]]))
    assert render(tmp_path / "many.npy").exit_code == 0
    third = tmp_path / "out" / "many_002.png"
    assert rerender(third, "-o", tmp_path / "again.png").exit_code == 0
    assert np.array_equal(pixels(tmp_path / "again.png"), pixels(third))


def test_a_picture_saved_by_python_finds_its_scan(
    rerender: Callable[..., Result], scans: Path, tiny_weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import z2p_core

    monkeypatch.chdir(tmp_path)
    picture = z2p_core.render("scans/one.npy", weights=tiny_weights, size=40)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    saved = picture.on("white").save("deep/er/a.png")
    assert read_record(saved)["input"]["path"] == "../../../scans/one.npy"  # relative: the folder may move
    shutil.copytree(tmp_path, tmp_path.with_name("moved"))
    shutil.rmtree(scans)
    result = rerender(tmp_path.with_name("moved") / "elsewhere" / saved)
    assert result.exit_code == 0, result.output
    assert str(tmp_path) not in picture._repr_png_().decode("latin1")


@pytest.mark.slow
def test_rerender_uses_the_recorded_engine(z2p: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    figure = tmp_path / "one.png"
    drawn = z2p("run-inference", scans / "one.npy", "-o", figure, "--engine", "openvino", "--resolution", 64)
    assert drawn.exit_code == 0, drawn.output
    assert read_record(figure)["engine"] == "openvino"
    assert z2p("rerender", figure).exit_code == 0
    assert (tmp_path / "one_2.png").read_bytes() == figure.read_bytes()
    assert z2p("rerender", figure, "-o", tmp_path / "other.png", "--engine", "torch").exit_code == 0
    assert read_record(tmp_path / "other.png")["engine"] == "torch"


def test_a_recorded_engine_that_is_missing_is_noted(
    rerender: Callable[..., Result], figure: Path, tmp_path: Path
) -> None:
    record = read_record(figure) | {"engine": "abacus"}
    write_picture(pixels(figure), figure, None, record)
    result = rerender(figure, "-o", tmp_path / "again.png")
    assert result.exit_code == 0 and "the engine 'abacus' that drew the picture is not installed" in result.stderr


def test_the_white_background_of_a_jpeg_is_kept(
    render: Callable[..., Result], rerender: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    figure = tmp_path / "a.jpg"
    assert render(scans / "one.npy", output=figure).exit_code == 0
    assert read_record(figure)["background"] == [1.0, 1.0, 1.0]
    assert rerender(figure, "-o", tmp_path / "a.png").exit_code == 0
    assert Image.open(tmp_path / "a.png").mode == "RGB"
    assert render(scans / "one.npy", output=tmp_path / "b.png").exit_code == 0
    for name, background in (("b.jpg", [1.0, 1.0, 1.0]), ("c.png", "transparent")):
        assert rerender(tmp_path / "b.png", "-o", tmp_path / name).exit_code == 0
        assert read_record(tmp_path / name)["background"] == background


@pytest.mark.parametrize(
    ("output", "message"), [("a.bmp", "expected a picture named"), ("/proc/x/a.png", "cannot write")]
)
def test_an_unwritable_output_is_refused_before_drawing(
    rerender: Callable[..., Result],
    figure: Path,
    tmp_path: Path,
    output: str,
    message: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("z2p_renderer.pipeline.inference.render_scan.render_scan", None)  # not called
    result = rerender(figure, "-o", tmp_path / output)
    assert result.exit_code == 2 and message in result.stderr


def test_rerender_writes_documents_and_reads_them(
    rerender: Callable[..., Result], figure: Path, tmp_path: Path
) -> None:
    document, again = tmp_path / "new.svg", tmp_path / "again.png"
    assert rerender(figure, "-o", document).exit_code == 0
    assert rerender(document, "-o", again).exit_code == 0
    assert "<svg" in document.read_text()
    assert np.array_equal(pixels(again), pixels(figure))
