"""Evaluation with textures: all methods get the same colors, and figures are told by texture and in all."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from z2p_core.camera import Camera
from z2p_core.config import EvaluateConfig
from z2p_core.interfaces import Painter, SettingError
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.cli.commands.evaluate import _print_means
from z2p_renderer.pipeline.evaluation import baselines as module
from z2p_renderer.pipeline.evaluation.evaluate import evaluate
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.rendering import textured_truth
from z2p_renderer.pipeline.rendering.textures import SeededTexture
from z2p_renderer.pipeline.shapes import shape
from z2p_renderer.storage.scans.clouds import write_mesh

SIDE = 48
KINDS = ("stripes", "smooth")
CONFIG = EvaluateConfig(views=2, points=300, resolution=SIDE, samples=2, denoise="off", textures=KINDS)


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Any, Any]]:
    """(name, colors, scene) of each picture asked for; a square stands in for Blender's renders."""
    asked: list[tuple[str, Any, Any]] = []

    def save_squares(mesh: Any, colors: Any, scenes: Any, out: Path, settings: object, name: str) -> None:
        out.mkdir(parents=True, exist_ok=True)
        picture, coverage = np.full((SIDE, SIDE, 4), 60, np.uint8), np.zeros((SIDE, SIDE), np.uint8)
        coverage[15:35, 15:35] = picture[15:35, 15:35, 3] = 255
        for stem, scene in scenes:
            asked.append((name, colors, scene))
            Image.fromarray(picture).save(out / f"{stem}.png")
            Image.fromarray(coverage).save(out / f"{stem}.coverage.png")

    monkeypatch.setattr(textured_truth, "render_textured_mesh", save_squares)
    monkeypatch.setattr(module, "render_textured_mesh", save_squares)
    return asked


@pytest.fixture
def meshes(tmp_path: Path) -> dict[str, Path]:
    write_mesh(tmp_path / "vase.ply", *shape("vase"))
    return {"vase": tmp_path / "vase.ply"}


def run(
    meshes: dict[str, Path], weights: Path, folder: Path, *names: str, config: EvaluateConfig = CONFIG
) -> dict[str, Any]:
    path = evaluate(meshes, weights, folder / "out", config, folder / "truth", baselines=names)
    data: dict[str, Any] = json.loads(path.read_text())
    return data


def test_each_texture_has_rows_means_and_pictures(rendered, meshes, tiny_weights, tmp_path) -> None:
    data = run(meshes, tiny_weights, tmp_path, "balls", "screen")
    for theirs in (data, *data["baselines"].values()):
        drawn = [(row["texture"], row["view"]) for row in theirs["rows"]]
        assert drawn == [(kind, view) for kind in KINDS for view in (0, 1)]
        assert list(theirs["textures"]) == list(KINDS)
        means = [theirs["textures"][kind]["means"]["flip"] for kind in KINDS]
        assert np.mean(means) == pytest.approx(theirs["means"]["flip"], abs=1e-5)
    assert [one["name"] for one in data["settings"]["textures"]] == list(KINDS)
    pictures = {path.name for path in (tmp_path / "out" / "pictures").iterdir()}
    assert pictures == {f"vase_0_{view}_{kind}{name}.png" for view in (0, 1) for kind in KINDS
                        for name in ("", "_balls", "_screen")}  # fmt: skip


def test_all_methods_get_the_textures_colors(rendered, meshes, tiny_weights, tmp_path, monkeypatch) -> None:
    given, plain = [], Renderer.render

    def render(self: Renderer, cloud: np.ndarray, *arguments: Any) -> np.ndarray:
        given.append((cloud, arguments[-1]))
        return plain(self, cloud, *arguments)

    monkeypatch.setattr(Renderer, "render", render)
    run(meshes, tiny_weights, tmp_path, "balls")
    truths = [colors for name, colors, _ in rendered if name.startswith("vase")]
    assert all(isinstance(one, SeededTexture) for one in truths) and len(truths) == 4
    balls = [(colors, scene) for name, colors, scene in rendered if name == "balls"]
    for (cloud, colors), texture, (vertices, scene) in zip(given, truths, balls, strict=True):
        unplaced = (cloud - (0, 0, scene.lift)) @ np.array(scene.rotation)
        agree = np.isclose(colors.albedo, texture.albedo(unplaced), atol=1e-3).all(axis=1)
        assert agree.mean() > 0.98  # all but points at an edge of colors
        np.testing.assert_array_equal(vertices.reshape(len(cloud), -1, 3)[:, 0], colors.albedo)


def test_textured_pictures_are_kept_apart(rendered, meshes, tiny_weights, tmp_path) -> None:
    def new(config: EvaluateConfig) -> int:
        before = len(rendered)
        run(meshes, tiny_weights, tmp_path, "balls", config=config)
        return len(rendered) - before

    assert new(CONFIG) == 8 and new(CONFIG) == 0
    assert new(replace(CONFIG, textures=("spots",))) == 4
    assert new(replace(CONFIG, textures=("spots", "smooth"))) == 0
    assert new(replace(CONFIG, views=3, textures=("spots",))) == 2
    assert new(replace(CONFIG, points=200, textures=("spots",))) == 2


def test_painters_without_colors_draw_the_mean() -> None:
    class Flat(Painter):
        name, version = "flat", "1"

        def paint(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
            return np.full((camera.height, camera.width, 4), scene.material["Base Color"], np.float32)

    albedo, scene = np.array([[0.2, 0.4, 0.0], [0.4, 0.0, 0.2]], np.float32), SceneDescription()
    picture = Flat().paint_colored(np.zeros((2, 3), np.float32), albedo, Camera(4, 4), scene)
    np.testing.assert_allclose(picture[0, 0], [0.3, 0.2, 0.1, 1], atol=1e-6)
    assert scene == SceneDescription()


def test_weights_of_one_color_are_refused(rendered, meshes, tiny_weights, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(Renderer, "draws_colors", False)
    with pytest.raises(SettingError, match="textures: expected weights that draw colours"):
        run(meshes, tiny_weights, tmp_path)
    assert not rendered


def test_unknown_texture_is_refused_at_once(z2p: Callable[..., Result], meshes, tmp_path) -> None:
    result = z2p("evaluate", "--meshes", tmp_path, "--output", tmp_path / "out", "--textures", "plaid")
    assert result.exit_code and "unknown texture 'plaid'; installed: checks, " in result.output
    assert not (tmp_path / "out").exists()


def test_figures_are_printed_by_texture_and_in_all(rendered, meshes, tiny_weights, tmp_path, capsys) -> None:
    _print_means(run(meshes, tiny_weights, tmp_path, "balls"))
    lines = capsys.readouterr().out.splitlines()
    heads = [line for line in lines if line.endswith("balls")]
    assert [line.split("  ")[0] for line in heads] == ["stripes", "smooth", "all textures"]
    assert sum(line.startswith("psnr_foreground ") for line in lines) == 3


@pytest.mark.slow
def test_colors_come_out_in_real_pictures(meshes, tiny_weights, tmp_path) -> None:
    config = replace(CONFIG, views=1, points=2000, samples=8, textures=("smooth", "uniform"))
    run(meshes, tiny_weights, tmp_path, "bpa", "splats", config=config)
    for kind in config.textures:
        truth = next(path for path in (tmp_path / "truth" / "textured").rglob("picture.png") if is_of(path, kind))
        inside = np.asarray(Image.open(truth.with_suffix(".coverage.png"))) > 250
        for name in ("bpa", "splats"):
            drawn = tmp_path / "out" / "pictures" / f"vase_0_0_{kind}_{name}.png"
            theirs, true = (np.asarray(Image.open(path))[inside, :3].astype(float) for path in (drawn, truth))
            ratio = theirs.mean(axis=0) / true.mean(axis=0)  # a few holes and dark triangles
            assert np.abs(ratio - 1).max() < 0.25, (kind, name)
            if kind == "smooth":
                assert np.corrcoef(theirs[:, 0] - theirs[:, 2], true[:, 0] - true[:, 2])[0, 1] > 0.8, name


def is_of(picture: Path, kind: str) -> bool:
    """Whether a stored truth is one of a texture."""
    fields = json.loads((picture.parent / "manifest.json").read_text())["fields"]
    return bool(fields["texture"]["plugin"]["name"] == kind)
