"""One scan to one picture: trimmed to what shows, averaged down from larger ones, with a record that tells all."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from z2p_core.images import shrink, unit_from_bytes
from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import build_record, render_scan
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.inference.trim import trim_to_content
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.storage.scans.clouds import usable


@pytest.fixture(scope="module")
def renderer(tiny_weights: Path) -> Renderer:
    return Renderer(tiny_weights)


def test_trimming_keeps_all_that_shows_and_a_margin() -> None:
    picture = np.zeros((100, 120, 4), np.uint8)
    picture[40:60, 30:90] = 255
    picture[70, 50:54, 3] = 10  # a faint shadow
    picture[5, 5, 3] = 14  # a lone pixel at the border
    cut = trim_to_content(picture)
    assert cut.shape == (31 + 4, 60 + 4, 4)
    assert np.array_equal(cut, picture[38:73, 28:92])
    edge = np.full((10, 10, 4), 255, np.uint8)
    assert np.array_equal(trim_to_content(edge), edge)
    empty = np.zeros((10, 10, 4), np.uint8)
    assert np.array_equal(trim_to_content(empty), empty)


def test_supersampling_averages_in_linear_light(renderer: Renderer, cloud: np.ndarray) -> None:
    scan, look = usable(cloud), Look(width=40, height=32)
    large = render_scan(renderer, scan, "", replace(look, width=120, height=96)).picture
    small = render_scan(renderer, scan, "", replace(look, supersample=3)).picture
    assert small.shape == (32, 40, 4)
    inside = slice(4, -4)  # where no shadow fades
    assert np.abs(small - 255 * shrink(unit_from_bytes(large), 3))[inside, inside].max() <= 0.51
    with pytest.raises(SettingError, match="at most 8192"):
        Look(width=4096, supersample=4)


def test_the_record_draws_the_same_picture_again(renderer: Renderer, cloud: np.ndarray) -> None:
    look = Look({"color": (0.5, 0.1, 0.2)}, PlacementOptions("+Y", azimuth=12.0), 48, 40)
    drawing = render_scan(renderer, usable(cloud), ".ply", look)
    made_by = build_record(drawing, look, {"name": "a.ply"})
    assert json.loads(json.dumps(made_by, allow_nan=False)) == made_by
    assert made_by["controls"]["color"] == [0.5, 0.1, 0.2] and made_by["controls"]["elevation"] == [20.0]
    assert made_by["weights"] == renderer.weights and len(made_by["weights"]["sha256"]) == 64
    assert (made_by["resolution"], made_by["input"]) == ([48, 40], {"name": "a.ply"})
    same_camera = replace(look, placement_options=PlacementOptions(viewpoint=drawing.viewpoint))
    again = render_scan(renderer, usable(cloud), ".ply", same_camera)
    assert np.array_equal(again.picture, drawing.picture)


def test_a_shared_floor_is_drawn_at_and_never_above_the_cloud(
    renderer: Renderer, cloud: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    floors: list[float | None] = []
    original = renderer.render

    def render(placed: np.ndarray, *rest: object, **named: object) -> np.ndarray:
        floors.append(rest[3])  # values, width, height, floor
        return original(placed, *rest, **named)

    monkeypatch.setattr(renderer, "render", render)
    own = render_scan(renderer, usable(cloud), "", Look(width=40, height=40)).viewpoint
    lowest = float(own.place(cloud)[:, 2].min())
    for floor in (None, lowest - 0.4, lowest + 0.4):
        look = Look(placement_options=PlacementOptions(viewpoint=replace(own, floor=floor)), width=40, height=40)
        render_scan(renderer, usable(cloud), "", look)
    assert floors == [None, None, pytest.approx(lowest - 0.4), pytest.approx(lowest)]
