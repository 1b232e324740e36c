"""The page in a real browser: look around, save, and the copied command makes the same file."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Page

REST = (
    "typeof panes !== 'undefined' && panes.length "
    "&& panes.every(one => !one.busy && !one.wanted && one.frame.dataset.quality === 'full')"
)
"""True once the page is loaded and all its pictures are the full ones."""


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
def test_what_a_browser_saves_is_what_its_copied_command_makes(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(600, 3))
    np.save(tmp_path / "ball.npy", points / np.linalg.norm(points, axis=1, keepdims=True) * [1, 2, 3])
    command = [sys.executable, "-m", "z2p_renderer.pipeline.cli"]
    viewer = subprocess.Popen([*command, "view", "ball.npy", "--port", "0", "--no-browser"], cwd=tmp_path,
                              stdout=subprocess.PIPE, text=True)  # fmt: skip
    assert viewer.stdout is not None
    page = Page(viewer.stdout.readline().strip(), tmp_path / "profile")
    try:
        page.wait(REST)
        before = page.run("state.azimuth")
        page.drag(300, 300, 80, 40)
        page.run("setControl('light', [3.6, 20, 40])")
        page.wait(f"state.azimuth !== {before or 'null'} && restTimer")
        page.run("new Promise(done => setTimeout(done, 2 * REST_MS))")
        page.wait(REST)
        page.run("at('save').click()")
        page.wait("at('status').textContent.startsWith('Saved')")
        words = shlex.split(page.run("freshRecipe().then(found => found.command)"))
        saved = (tmp_path / "pictures" / "ball.png").read_bytes()
        (tmp_path / "pictures" / "ball.png").unlink()
        assert {"--view", "--light", "--elevation"} <= set(words)
        subprocess.run([*command, *words[1:]], cwd=tmp_path, check=True, capture_output=True)
        assert (tmp_path / "pictures" / "ball.png").read_bytes() == saved
        page.send("Page.navigate", url="about:blank")
        assert viewer.wait(30) == 0
    finally:
        page.close()
        viewer.kill()
