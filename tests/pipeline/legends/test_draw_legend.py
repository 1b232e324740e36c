"""Color bars and legends of classes: beside a picture, and as files of their own."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from z2p_core.coloring.class_palettes import class_colors
from z2p_core.coloring.colormaps import colormap_lut
from z2p_core.coloring.scales import ClassColors, ColorScale
from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.legends.draw_legend import draw_onto, ink_on, write_legend

BAR = ColorScale("intensity", "viridis", 0.0, 12.0, "dB")
CLASSES = class_colors("classification", np.array([2, 5, 6, 9]))
ODD_TEXTS = [
    "$x_i^2$", r"$\frac{", "a_b^c", "高さ 😀 \U000f0000", "", " \n\t\x00\ud800", "<b>&amp;", "x" * 5000, "é\u0301" * 99,
]  # fmt: skip


def blank(height: int, alpha: int = 0) -> np.ndarray:
    picture = np.full((height, height, 4), 200, np.uint8)
    picture[..., 3] = alpha
    return picture


def svg_texts(path: Path) -> list[str]:
    return [element.text or "" for element in ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")]


@pytest.mark.parametrize("scale", [BAR, CLASSES], ids=["bar", "classes"])
@pytest.mark.parametrize("height", [32, 256, 777])
def test_a_picture_is_widened_and_kept(scale: ColorScale | ClassColors, height: int) -> None:
    picture = blank(height)
    wide = draw_onto(picture, scale)
    assert wide.dtype == np.uint8 and wide.shape[0] == height and wide.shape[1] > height
    assert np.array_equal(wide[:, :height], picture)
    assert wide[..., 3].any() and not wide[0, height:, 3].any()  # something is drawn, and its edges are transparent


def test_the_bar_has_the_colormaps_colors() -> None:
    strip = draw_onto(blank(1024), BAR)[:, 1024:]
    column = strip[:, 33 + 10]  # the bar begins one height of the font to the right
    drawn = column[column[:, 3] == 255][4:-4, :3] / 255  # without its outline
    expected = colormap_lut("viridis")[::-1][np.linspace(1, 254, len(drawn)).round().astype(int)]
    assert len(drawn) > 700
    assert np.abs(drawn - expected).max() < 0.04


def test_the_strip_grows_with_the_picture() -> None:
    shares = [draw_onto(blank(height), BAR).shape[1] / height for height in (512, 1024, 2048)]
    assert max(shares) - min(shares) < 0.02


def test_swatches_have_the_classes_colors() -> None:
    strip = draw_onto(blank(512), CLASSES)[:, 512:]
    opaque = strip[strip[..., 3] == 255][:, :3].astype(int)
    for entry in CLASSES.entries:
        wanted = np.round(np.array(entry.color) * 255)
        assert (np.abs(opaque - wanted).max(axis=1) <= 1).sum() > 150, entry.name


@pytest.mark.parametrize(
    ("background", "is_dark_ink"),
    [(None, True), ((1, 1, 1), True), ((0, 0, 0), False), ((0.1, 0.1, 0.4), False), ((0.9, 0.8, 0.2), True)],
)
def test_texts_stand_out_on_the_background(background: tuple[float, float, float] | None, is_dark_ink: bool) -> None:
    assert (max(ink_on(background)) < 0.3) is is_dark_ink
    strip = draw_onto(blank(256), class_colors("x", np.array([])), background)[:, 256:]
    drawn = strip[strip[..., 3] > 200][:, :3]
    assert len(drawn) and (drawn.mean() < 80 if is_dark_ink else drawn.mean() > 175)


def test_opaque_pictures_stay_opaque() -> None:
    wide = draw_onto(blank(128, alpha=255), BAR, (0.0, 0.0, 1.0))
    assert (wide[..., 3] == 255).all()
    assert np.array_equal(wide[0, -1], [0, 0, 255, 255])
    assert np.array_equal(draw_onto(blank(128, alpha=255), BAR)[0, -1], [255, 255, 255, 255])


def test_svg_holds_its_text(tmp_path: Path) -> None:
    assert {"intensity [dB]", "0", "2", "12"} <= set(svg_texts(write_legend(BAR, tmp_path / "bar.svg")))
    assert svg_texts(write_legend(CLASSES, tmp_path / "classes.svg")) == [
        "ground", "high vegetation", "building", "water", "classification"]  # fmt: skip


@pytest.mark.parametrize("name", ["bar.svg", "bar.pdf"])
def test_vector_files_hold_no_pixels(name: str, tmp_path: Path) -> None:
    content = write_legend(BAR, tmp_path / name).read_bytes()
    assert len(content) < 100_000
    assert b"<image" not in content and b"/Subtype /Image" not in content
    assert content.startswith(b"%PDF" if name.endswith("pdf") else b"<?xml")


def test_png_files_have_300_dpi(tmp_path: Path) -> None:
    with Image.open(write_legend(BAR, tmp_path / "bar.PNG")) as opened:
        assert opened.info["dpi"] == pytest.approx((300, 300), abs=1)
        assert opened.mode == "RGBA" and opened.getchannel("A").getpixel((0, 0)) == 0


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
@pytest.mark.parametrize("scale", [BAR, CLASSES], ids=["bar", "classes"])
def test_the_same_legend_is_the_same_file(scale: ColorScale | ClassColors, suffix: str, tmp_path: Path) -> None:
    import matplotlib

    first = write_legend(scale, tmp_path / f"a{suffix}").read_bytes()
    with matplotlib.rc_context({"font.size": 30, "svg.fonttype": "path", "font.family": "serif"}):
        before = dict(matplotlib.rcParams)
        second = write_legend(scale, tmp_path / f"b{suffix}").read_bytes()
        assert dict(matplotlib.rcParams) == before
    assert first == second


@pytest.fixture
def no_warnings(caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    with warnings.catch_warnings(), caplog.at_level(logging.WARNING):
        warnings.simplefilter("error")
        yield
    assert not caplog.records


@pytest.mark.parametrize("text", ODD_TEXTS, ids=range(len(ODD_TEXTS)))
def test_odd_names_of_fields_are_drawn(text: str, tmp_path: Path, no_warnings: None) -> None:
    scale = ColorScale(text, "tab10", 0, 1, text)
    assert draw_onto(blank(128), scale).shape[1] < 128 * 2
    write_legend(scale, tmp_path / "legend.svg")


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_odd_names_of_classes_are_drawn(suffix: str, tmp_path: Path, no_warnings: None) -> None:
    classes = class_colors(ODD_TEXTS[3], np.arange(len(ODD_TEXTS)), dict(enumerate(ODD_TEXTS)))
    write_legend(classes, tmp_path / f"legend{suffix}")


def test_dollars_are_no_formulas(tmp_path: Path) -> None:
    assert "$x_i^2$ [$m^2$]" in svg_texts(
        write_legend(ColorScale("$x_i^2$", "turbo", 0, 1, "$m^2$"), tmp_path / "bar.svg"))


def test_long_names_end_in_an_ellipsis(tmp_path: Path) -> None:
    label = svg_texts(write_legend(ColorScale("height " * 50, "turbo", 0, 1, "m"), tmp_path / "bar.svg"))[-1]
    assert label.startswith("height height") and label.endswith("… [m]")


@pytest.mark.parametrize("limits", [(5, 5), (0, 0), (-1e308, 1e308), (1e9, 1e9 + 1e-7), (1.3e9, 1.3e9 + 60), (0, 1e-7)])
def test_any_limits_can_be_drawn(limits: tuple[float, float], tmp_path: Path) -> None:
    scale = ColorScale("time", "batlow", *limits)
    assert draw_onto(blank(256), scale).shape[1] < 256 * 2
    texts = svg_texts(write_legend(scale, tmp_path / "bar.svg"))
    assert len(texts) == 2 if limits[0] == limits[1] else len(texts) >= 2


def test_256_classes_find_room(tmp_path: Path) -> None:
    classes = class_colors("instance", np.arange(256))
    assert draw_onto(blank(512), classes).shape[1] < 512 * 2.5
    assert len(svg_texts(write_legend(classes, tmp_path / "classes.svg"))) == 257


def test_classes_without_room_are_counted() -> None:
    small = draw_onto(blank(64), class_colors("instance", np.arange(256)))
    assert small.shape[1] < 64 * 12


def test_thousands_of_classes_end_in_a_count(tmp_path: Path) -> None:
    texts = svg_texts(write_legend(class_colors("instance", np.arange(2000)), tmp_path / "classes.svg"))
    shown = len(texts) - 2  # and the title and the count
    assert f"… and {2000 - shown:,} more" in texts


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"\.svg, \.png or \.pdf"):
        write_legend(BAR, tmp_path / "bar.jpg")


def test_unknown_colormaps_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match="viridis"):
        write_legend(ColorScale("height", "virdis", 0, 1), tmp_path / "bar.svg")
    assert not list(tmp_path.iterdir())


def test_files_can_have_a_background(tmp_path: Path) -> None:
    with Image.open(write_legend(BAR, tmp_path / "bar.png", (0.0, 0.0, 0.0))) as opened:
        pixels = np.asarray(opened.convert("RGBA"))
    assert (pixels[..., 3] == 255).all() and (pixels[0, 0, :3] == 0).all() and pixels[..., :3].max() > 200
