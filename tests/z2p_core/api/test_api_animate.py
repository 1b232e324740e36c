"""`animate` writes turntables, series and tables of clouds; `render` takes a color for each cloud of a batch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import z2p_core
from z2p_core.interfaces import SettingError

BALL = np.random.default_rng(0).normal(size=(300, 3))
BALL /= np.linalg.norm(BALL, axis=1, keepdims=True)
BATCH = np.stack([BALL, BALL * (1, 1, 0.5)])


def test_a_batch_takes_a_color_for_each_cloud() -> None:
    sheet = z2p_core.render(BATCH, size=48, color=["red", (0, 0, 1.0)])
    red, blue = (np.median(part.array[20:28, 20:28].reshape(-1, 4), axis=0) for part in sheet)
    assert red[0] > 150 > 60 > red[2] and blue[2] > 150 > 60 > blue[0]
    assert z2p_core.render(BALL, size=48, color=[0.1, 0.2, 0.3]).record["controls"]["color"] == [0.1, 0.2, 0.3]
    with pytest.raises(SettingError, match="each of 2 clouds, got a list of 3"):
        z2p_core.render(BATCH, size=48, color=["red", "red", "red"])


def test_clouds_become_films(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    for points, name, options, count in (
        (BALL, "turn.webp", {"frames": 2}, 2),
        (BALL, "orbit.webp", {"frames": 2, "motion": "orbit"}, 2),
        (BATCH, "series.apng", {"blend": 1, "turns": 0.5, "on_frame": lambda done, all: seen.append((done, all))}, 3),
        (BATCH, "table.gif", {"arrange": "table", "frames": 2, "color": ["red", "teal"]}, 2),
    ):  # fmt: skip
        path = z2p_core.animate(points, tmp_path / name, size=40, **options)  # type: ignore[arg-type]
        film = Image.open(path)
        assert film.n_frames == count and film.size == (80 if name == "table.gif" else 40, 40)
    assert seen == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize(("options", "message"), [
    ({"frames": 3}, "hold, blend and turns"),
    ({"color": ["red", "teal"]}, "one color for a series"),
    ({"blend": -1}, "blend as a whole number from 0"),
    ({"blend_by": "magic"}, "auto, points or pictures"),
    ({"sizes": 3}, "did you mean size"),
])  # fmt: skip
def test_wrong_options_are_refused(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        z2p_core.animate(BATCH, tmp_path / "a.webp", **options)
    assert not (tmp_path / "a.webp").exists()
