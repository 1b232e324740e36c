"""The gallery in a real browser, from a file and offline: pictures decode, search finds, the background changes."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from z2p_renderer.pipeline.outputs.gallery import write_gallery
from z2p_renderer.storage.images.image_files import write_picture

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")]


def chromium(*words: str, folder: Path) -> str:
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
               f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=3000", *words]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """A gallery of a red, a green and a blue picture; one has an evil name."""
    for name, color in {"red": (255, 0, 0), 'gr"een<img src=x onerror=document.title=1>': (0, 255, 0),
                        "blue": (0, 0, 255)}.items():  # fmt: skip
        picture = np.zeros((64, 64, 4), np.uint8)
        picture[16:48, 16:48] = (*color, 255)
        made_by = {"record": 1, "controls": {"color": [c / 255 for c in color]}, "input": {"name": f"{name}.ply"}}
        write_picture(picture, tmp_path / f"{name}.png", record=made_by)
    return write_gallery(sorted(tmp_path.glob("*.png")), tmp_path / "gallery.html")


def test_search_hides_what_does_not_match(page: Path, tmp_path: Path) -> None:
    everything = chromium("--dump-dom", page.as_uri(), folder=tmp_path)
    assert ">3 of 3<" in everything
    assert "<title>1</title>" not in everything
    found = chromium("--dump-dom", f"{page.as_uri()}#q=blue%20PLY", folder=tmp_path)
    assert ">1 of 3<" in found
    assert len(re.findall(r"<figure [^>]*hidden", found)) == 2
    assert re.search(r'<p id="none" hidden', found)
    assert not re.search(r'<p id="none" hidden', chromium("--dump-dom", f"{page.as_uri()}#q=violet", folder=tmp_path))


@pytest.mark.parametrize(("back", "paper", "cell"), [("light", 255, 255), ("dark", 21, 29)])
def test_the_page_is_drawn(page: Path, tmp_path: Path, back: str, paper: int, cell: int) -> None:
    shot = tmp_path / f"{back}.png"
    chromium(f"--screenshot={shot}", "--window-size=1000,600", f"{page.as_uri()}#back={back}", folder=tmp_path)
    pixels = np.asarray(Image.open(shot).convert("RGB")).astype(int)
    assert pixels[-5, -5, 0] == paper
    for color in ((255, 0, 0), (0, 255, 0), (0, 0, 255)):
        assert (np.abs(pixels - color).max(-1) < 40).sum() > 5000, color  # each picture is to be seen
    assert ((np.abs(pixels[..., 0] - cell) < 2).sum()) > 10_000
