"""Margins and soft edges along every way to a picture: the object's size, the shadow's end, and the record of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from PIL import Image, ImageSequence

import z2p_core
from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import render_scan
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.inference.trim import content_box, trim_to_content
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.storage.images.image_files import read_record
from z2p_renderer.storage.scans.clouds import usable


@pytest.fixture
def shadowy(monkeypatch: pytest.MonkeyPatch) -> None:
    """A renderer that draws its points alone, as squares, and a shadow all over the picture."""
    from z2p_core.camera import Camera, turn
    from z2p_renderer.pipeline.inference.prepared_render import PreparedRender

    def render(
        self: Renderer, cloud: np.ndarray, values: Any = None, width: int = 512, height: int = 512, floor: Any = None,
        colors: Any = None, reduction: Any = None,
    ) -> np.ndarray:  # fmt: skip
        picture = np.zeros((height, width, 4), np.uint8)
        picture[..., 3] = 110
        pixels, _ = Camera(width, height, 20.0).project(cloud)
        columns, rows = np.clip(pixels.astype(int), 0, (width - 1, height - 1)).T
        picture[rows, columns] = (200, 100, 50, 255)
        return picture

    def render_prepared(
        self: PreparedRender, values: Any, width: int, height: int, azimuth: float = 0.0, relight: Any = None
    ) -> np.ndarray:  # fmt: skip
        return render(self._renderer, self._cloud @ turn(azimuth).T, values, width, height)

    monkeypatch.setattr(Renderer, "render", render)
    monkeypatch.setattr(PreparedRender, "render", render_prepared)


def border(picture: np.ndarray) -> int:
    """The largest alpha along the four edges."""
    alpha = picture[..., 3]
    return int(max(alpha[0].max(), alpha[-1].max(), alpha[:, 0].max(), alpha[:, -1].max()))


def free(picture: np.ndarray) -> float:
    """What is free around the object, of the shorter side."""
    rows, columns = np.nonzero(picture[..., 3] == 255)
    height, width = picture.shape[:2]
    return min(rows.min(), columns.min(), height - 1 - rows.max(), width - 1 - columns.max()) / min(height, width)


def sphere() -> np.ndarray:
    """Points (3000, 3) on a sphere far from the origin."""
    points = np.random.default_rng(0).normal(size=(3000, 3))
    return 7 * points / np.linalg.norm(points, axis=1)[:, None] + (100.0, 0.0, 50.0)


@pytest.mark.usefixtures("shadowy")
@pytest.mark.parametrize("margin", [None, 0.02, 0.3])
@pytest.mark.parametrize("size", [(128, 128), (160, 96)])
def test_a_margin_is_what_is_free_and_no_shadow_is_cut(
    tiny_weights: Path, margin: float | None, size: tuple[int, int]
) -> None:
    picture = z2p_core.render(sphere(), weights=tiny_weights, size=size, margin=margin)
    assert free(picture.array) == pytest.approx(0.103 if margin is None else margin, abs=0.02)
    assert border(picture.array) == 0 and picture.array[..., 3].max() == 255
    assert picture.record["margin"] == margin
    again = z2p_core.render(sphere(), weights=tiny_weights, size=size, camera=picture)
    assert np.array_equal(again.array, picture.array), "the camera has the margin"


@pytest.mark.usefixtures("shadowy")
def test_python_and_the_command_line_draw_equal_pictures(
    z2p: Callable[..., Result], tiny_weights: Path, tmp_path: Path
) -> None:
    clouds = np.stack([sphere(), sphere() * (1.0, 0.5, 0.7)])
    sheet = z2p_core.render(clouds, weights=tiny_weights, size=64, margin="20%")
    np.save(tmp_path / "both.npy", clouds)
    result = z2p("render", tmp_path / "both.npy", "-o", tmp_path, "--weights", tiny_weights, "--size", 64,
                 "--margin", "0.2", "--up", "Z")  # fmt: skip
    assert result.exit_code == 0, result.output
    for index, picture in enumerate(sheet):
        file = tmp_path / f"both_{index:03d}.png"
        assert np.array_equal(np.asarray(Image.open(file)), picture.array) and border(picture.array) == 0
        assert read_record(file)["margin"] == 0.2


@pytest.mark.usefixtures("shadowy")
def test_a_series_a_loop_and_a_preview_have_it_too(
    z2p: Callable[..., Result], tiny_weights: Path, tmp_path: Path
) -> None:
    for name, offset in (("a", 0.0), ("b", 14.0)):
        np.save(tmp_path / f"{name}.npy", sphere() + np.array([offset, 0.0, 0.0]))
    words = ("--weights", tiny_weights, "--size", 96, "--margin", 0.25)
    result = z2p("render", tmp_path / "a.npy", tmp_path / "b.npy", "-o", tmp_path, "--same-frame", *words,
                 "--save-camera", tmp_path / "camera.json")  # fmt: skip
    assert result.exit_code == 0, result.output
    pictures = [np.asarray(Image.open(tmp_path / f"{name}.png")) for name in "ab"]
    assert min(map(free, pictures)) == pytest.approx(0.25, abs=0.02) and not any(map(border, pictures))
    again = z2p("render", tmp_path / "b.npy", "-o", tmp_path / "again.png", *words[:4], "--load-camera",
                tmp_path / "camera.json")  # fmt: skip
    assert again.exit_code == 0 and np.array_equal(np.asarray(Image.open(tmp_path / "again.png")), pictures[1])
    assert z2p("animate", tmp_path / "a.npy", "-o", tmp_path / "a.webp", "--frames", 3, *words).exit_code == 0
    for frame in ImageSequence.Iterator(Image.open(tmp_path / "a.webp")):
        shown = np.asarray(frame.convert("RGBA"))
        assert free(shown) == pytest.approx(0.25, abs=0.02) and border(shown) <= 2
    preview = z2p_core.Previewer(weights=tiny_weights, resolution=96, margin=0.25)
    assert preview(sphere()).shape == (3, 96, 96) and preview.error is None
    assert preview(sphere())[:, [0, -1]].min() == 255, "white at the edge"


@pytest.mark.usefixtures("shadowy")
def test_rerender_keeps_changes_and_drops_a_margin(
    z2p: Callable[..., Result], tiny_weights: Path, tmp_path: Path
) -> None:
    def made(name: str, *words: object) -> np.ndarray:
        assert (done := z2p(*words, "-o", tmp_path / name, "--weights", tiny_weights)).exit_code == 0, done.output
        return np.asarray(Image.open(tmp_path / name))

    np.save(tmp_path / "a.npy", sphere())
    first = made("a.png", "render", tmp_path / "a.npy", "--size", 96, "--margin", 0.25)
    wide = made("b.png", "render", tmp_path / "a.npy", "--size", 96, "--margin", 0.02)
    tight = made("t.png", "render", tmp_path / "a.npy", "--size", 96, "--fit", "tight", "--margin", 0.25)
    assert np.array_equal(made("c.png", "rerender", tmp_path / "a.png"), first)
    assert np.array_equal(made("d.png", "rerender", tmp_path / "a.png", "--margin", "2%"), wide)
    assert np.array_equal(made("e.png", "rerender", tmp_path / "t.png"), tight)
    assert np.array_equal(made("f.png", "rerender", tmp_path / "t.png", "--fit", "frame", "--margin", 0.25), first)


def test_a_margin_and_a_camera_choose_the_size_twice(
    z2p: Callable[..., Result], tiny_weights: Path, cloud: np.ndarray, tmp_path: Path
) -> None:
    picture = z2p_core.render(cloud, weights=tiny_weights, size=32)
    with pytest.raises(SettingError, match="camera and margin both"):
        z2p_core.render(cloud, weights=tiny_weights, size=32, camera=picture, margin=0.2)
    np.save(tmp_path / "a.npy", cloud)
    picture.save(tmp_path / "a.png")
    words = ("render", tmp_path / "a.npy", "--load-camera", tmp_path / "a.png", "--margin", 0.2, "-o", tmp_path / "b")
    assert "--load-camera and --margin both" in z2p(*words).output


def test_a_trimmed_picture_has_its_margin_even_beyond_the_frame() -> None:
    picture = np.zeros((100, 120, 4), np.uint8)
    picture[0:60, 30:90] = 255
    assert trim_to_content(picture).shape == (62, 64, 4), "as far as the frame goes"
    for margin in (0.0, 0.02, 0.3):
        wide = round(100 * margin)
        part = trim_to_content(picture, margin)
        assert part.shape == (60 + 2 * wide, 60 + 2 * wide, 4)
        assert (part[wide : wide + 60, wide : wide + 60] == 255).all() and part.sum() == 255 * 60 * 60 * 4
    assert content_box(picture[..., 3], 0.1) == (-10, 70, 20, 100)


def test_what_trains_and_measures_draws_as_before(tiny_weights: Path, cloud: np.ndarray) -> None:
    renderer = Renderer(tiny_weights)
    look = Look(width=64, height=64, placement_options=PlacementOptions("+Z", "front"))
    drawing = render_scan(renderer, usable(cloud), "", look)
    raw = renderer.render(drawing.viewpoint.place(cloud), look.values, 64, 64)
    assert not np.array_equal(raw, drawing.picture), "the network's own picture is not faded"
    middle = slice(7, -7)
    assert np.array_equal(raw[middle, middle], drawing.picture[middle, middle])
    assert np.array_equal(render_scan(renderer, usable(cloud), "", replace(look, margin=None)).picture, drawing.picture)
