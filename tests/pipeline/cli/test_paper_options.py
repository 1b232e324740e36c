"""Width on paper, dots per inch, and PDF and SVG of single pictures."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from z2p_renderer.storage.images.image_files import read_record

Z2p = Callable[..., Result]


@pytest.fixture
def draw(z2p: Z2p, tiny_weights: Path, tmp_path: Path, cloud: np.ndarray) -> Callable[..., Result]:
    np.save(tmp_path / "a.npy", cloud)
    return lambda name, *words: z2p("render", tmp_path / "a.npy", "--weights", tiny_weights, "--output",
                                    tmp_path / name, *words)  # fmt: skip


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.jpg"])
def test_the_width_on_paper_sets_the_pixels(draw: Callable[..., Result], tmp_path: Path, name: str) -> None:
    assert draw(name, "--width-mm", 12.7, "--dpi", 96, "--quiet").exit_code == 0
    picture = Image.open(tmp_path / name)
    assert picture.size == (48, 48)
    assert float(picture.info["dpi"][0]) == pytest.approx(96, abs=0.02)


def test_the_width_and_the_pixels_set_the_dots_per_inch(draw: Callable[..., Result], tmp_path: Path) -> None:
    assert draw("a.png", "--width-mm", 25.4, "--resolution", "60,40").exit_code == 0
    assert Image.open(tmp_path / "a.png").info["dpi"][0] == pytest.approx(60, abs=0.02)
    both = draw("b.png", "--width-mm", 25.4, "--resolution", 60, "--dpi", 60)
    assert both.exit_code == 2 and "two of them" in both.output
    assert "expected 32 to 4096" in draw("b.png", "--width-mm", 2000).output


@pytest.mark.parametrize("kind", ["pdf", "svg"])
def test_documents_embed_the_picture_at_its_width_with_its_record(
    draw: Callable[..., Result], tmp_path: Path, kind: str
) -> None:
    words = ("--width-mm", 25.4, "--dpi", 40, "--scale-bar", "--unit", "m (a)")
    assert draw(f"a.{kind}", *words).exit_code == 0
    content = (tmp_path / f"a.{kind}").read_bytes()
    if kind == "svg":
        assert re.search(rb'<svg [^>]*width="72[.\d]*pt"', content) and b'<image' in content
    else:
        assert b"/Width 40" in content and re.search(rb"/MediaBox \[ 0 0 72[.\d]* 72", content)
    record = read_record(tmp_path / f"a.{kind}", complete=True)
    assert record["dpi"] == 40 and record["unit"] == "m (a)" and record["scale_bar"] is True
    assert "skipped" in draw(f"a.{kind}", *words).output
    assert "rendered" in draw(f"a.{kind}", "--width-mm", 25.4, "--dpi", 40).output  # without the bar


def test_a_unit_alone_is_refused(draw: Callable[..., Result]) -> None:
    assert "--scale-bar and --axes" in draw("a.png", "--unit", "m").output
