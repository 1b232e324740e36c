"""The examples run as they stand, and leave the pictures that they promise."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

EXAMPLES = Path(__file__).parents[2] / "examples"
MADE = {
    "render_arrays.py": ["same_camera.png", "second.webp", "sheet.png", "trimesh.png", "vase.png"],
    "training_preview.py": ["step_0000.png", "step_0100.png", "step_0200.png", "step_0300.png"],
}
KEPT = {"make_buffer_figure.py": "buffers.png", "make_overview.py": "overview.png"}
"""Script -> its figure in docs/images."""


@pytest.mark.slow
@pytest.mark.parametrize("name", MADE)
def test_an_example_runs_and_draws(name: str, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, EXAMPLES / name, tmp_path / "out"], capture_output=True, text=True,
                          env={**os.environ, "OMP_NUM_THREADS": "1"})  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == MADE[name]
    for path in (tmp_path / "out").iterdir():
        picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
        assert np.ptp(picture) > 100, path  # something is to be seen


@pytest.mark.slow
@pytest.mark.parametrize("name", KEPT)
def test_a_figure_of_the_docs_can_be_made_again(name: str, tmp_path: Path) -> None:
    out = tmp_path / "figure.png"
    done = subprocess.run([sys.executable, EXAMPLES / name, out], capture_output=True, text=True,
                          env={**os.environ, "OMP_NUM_THREADS": "1"})  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    made = np.asarray(Image.open(out).convert("RGB")).astype(int)
    kept = np.asarray(Image.open(EXAMPLES.parent / "docs" / "images" / KEPT[name]).convert("RGB")).astype(int)
    assert made.shape == kept.shape
    assert np.abs(made - kept).mean() < 2  # weights, fonts and palettes may change a little
