"""Evaluation: rows, means, stored ground truth, pictures and sheets; with synthetic pictures, and once with Blender."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.config import EvaluateConfig
from z2p_core.interfaces import ScanError, SettingError
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.quality.metrics import METRIC_NAMES
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline import render
from z2p_renderer.pipeline.evaluation.comparison_sheet import CELL_SIDE, ROWS_PER_SHEET, make_row, write_sheets
from z2p_renderer.pipeline.evaluation.evaluate import evaluate, sample_views, summarise
from z2p_renderer.pipeline.export import export_onnx
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.render import RenderSettings
from z2p_renderer.pipeline.rendering import ground_truth
from z2p_renderer.pipeline.rendering.mesh_samples import sample_cloud
from z2p_renderer.pipeline.rendering.views import place_in_scene
from z2p_renderer.pipeline.shapes import shape
from z2p_renderer.storage.models.checkpoints import WeightsError
from z2p_renderer.storage.results.fingerprints import file_digest
from z2p_renderer.storage.scans.clouds import read_mesh, write_mesh

SIDE = 48
CONFIG = EvaluateConfig(views=2, points=300, resolution=SIDE, samples=2, denoise="off")


def disc() -> tuple[np.ndarray, np.ndarray]:
    """A blue disc with a shadow beside it as RGBA, and the disc's coverage; uint8."""
    row, column = np.mgrid[:SIDE, :SIDE] - SIDE / 2 + 0.5
    coverage = np.where(row**2 + column**2 < 144, 255, 0).astype(np.uint8)
    picture = np.zeros((SIDE, SIDE, 4), np.uint8)
    picture[row > 0, 3] = 60
    picture[coverage > 0] = (60, 90, 200, 255)
    return picture, coverage


@pytest.fixture
def by_hand(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Stems of the discs that stand in for Blender's renders, in the order in which they were asked for."""
    rendered: list[str] = []

    def save_discs(mesh: Path, scenes: Any, out: Path, settings: RenderSettings, log: object) -> None:
        out.mkdir(parents=True, exist_ok=True)
        for stem, _ in scenes:
            if not (out / f"{stem}.png").exists():
                rendered.append(stem)
                for name, picture in zip((f"{stem}.png", f"{stem}.coverage.png"), disc(), strict=True):
                    Image.fromarray(picture).save(out / name)

    monkeypatch.setattr(ground_truth, "render_scenes", save_discs)
    return rendered


@pytest.fixture
def meshes(tmp_path: Path) -> dict[str, Path]:
    meshes = {}
    for name in ("gear", "wavy_sheet"):
        meshes[name] = tmp_path / f"{name}.ply"
        write_mesh(meshes[name], *shape(name))
    return meshes


def metrics(path: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(path.read_text())
    return data


def test_metrics_have_a_row_per_mesh_and_view(by_hand, meshes, tiny_weights: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    path = evaluate(meshes, tiny_weights, out, CONFIG, tmp_path / "truth")
    data = metrics(path)
    assert path == out / "metrics.json"
    assert [(row["mesh"], row["view"]) for row in data["rows"]] == [
        ("gear", 0), ("gear", 1), ("wavy_sheet", 0), ("wavy_sheet", 1)
    ]  # fmt: skip
    for name in METRIC_NAMES:
        values = [row[name] for row in data["rows"]]
        assert data["means"][name] == pytest.approx(np.mean(values), abs=1e-5)
        assert data["spread"][name] == pytest.approx(np.std(values), abs=1e-5)
        assert data["meshes"]["gear"][name] == pytest.approx(np.mean(values[:2]), abs=1e-5)
    assert all(row["elevation"] == 20 and row["values"]["elevation"] == [20] for row in data["rows"])
    assert data["settings"]["weights"] == {"name": "tiny.safetensors", "sha256": file_digest(tiny_weights)}
    assert str(tmp_path) not in path.read_text()
    for row in data["rows"]:
        with Image.open(out / "pictures" / f"{row['mesh']}_{row['seed']}_{row['view']}.png") as picture:
            assert (picture.mode, picture.size) == ("RGBA", (SIDE, SIDE))
    assert (out / "sheet.png").exists() and not (out / "sheet_2.png").exists()


def test_each_seed_is_measured_and_their_means_compared(by_hand, meshes, tiny_weights, tmp_path) -> None:
    config = replace(CONFIG, seed=3, seeds=2)
    several = metrics(evaluate(meshes, tiny_weights, tmp_path / "out", config, tmp_path / "t"))
    assert [row["seed"] for row in several["rows"]] == [3] * 4 + [4] * 4 and list(several["seeds"]) == ["3", "4"]
    alone = metrics(evaluate(meshes, tiny_weights, tmp_path / "one", replace(CONFIG, seed=4), tmp_path / "t"))
    for row, other in zip(alone["rows"], several["rows"][4:], strict=True):
        assert all(row[name] == other[name] for name in METRIC_NAMES)
    assert several["seeds"]["4"]["psnr_white"] == alone["means"]["psnr_white"]
    means = [several["seeds"][seed]["psnr_white"] for seed in ("3", "4")]
    assert several["spread_over_seeds"]["psnr_white"] == pytest.approx(np.std(means), abs=1e-5)
    assert len(list((tmp_path / "out" / "pictures").glob("*.png"))) == 8


def test_renderer_that_draws_the_truth_gets_the_best_metrics(by_hand, meshes, tiny_weights, tmp_path, monkeypatch):
    monkeypatch.setattr(Renderer, "render", lambda *_: disc()[0])
    means = metrics(evaluate(meshes, tiny_weights, tmp_path / "out", CONFIG, tmp_path / "truth"))["means"]
    assert means["psnr_white"] == means["psnr_foreground"] == 100
    others = [means[name] for name in ("ssim", "flip", "alpha_l1", "shadow_l1")]
    assert others == pytest.approx([1, 0, 0, 0], abs=1e-5)


def test_metrics_depend_on_seed_not_on_names_or_other_meshes(by_hand, meshes, tiny_weights, tmp_path) -> None:
    def rows(meshes: dict[str, Path], out: str, config: EvaluateConfig = CONFIG) -> list[dict[str, Any]]:
        data = metrics(evaluate(meshes, tiny_weights, tmp_path / out, config, tmp_path / "truth"))
        return [{**row, "mesh": "", "seconds": 0} for row in data["rows"]]

    both = rows(meshes, "both")
    assert rows({"another name": meshes["wavy_sheet"]}, "one") == both[2:]
    assert rows(meshes, "seed", replace(CONFIG, seed=1)) != both
    noisy = rows(meshes, "noisy", replace(CONFIG, noise=0.05))
    assert noisy != both and [row["values"] for row in noisy] == [row["values"] for row in both]


def test_requested_engine_runs_and_is_recorded(by_hand, meshes, tiny_weights, tmp_path, monkeypatch) -> None:
    started: list[object] = []

    class Watched(Renderer):
        def __init__(self, *words: Any, **named: Any) -> None:
            super().__init__(*words, **named)
            started.append(self.engine)

    monkeypatch.setattr("z2p_renderer.pipeline.evaluation.evaluate.Renderer", Watched)
    file = Path(shutil.copy(tiny_weights, tmp_path))
    export_onnx(file)
    data = {engine: metrics(evaluate(meshes, file, tmp_path / engine, CONFIG, tmp_path / "truth", engine=engine))
            for engine in ("torch", "onnxruntime")}  # fmt: skip
    assert started == ["torch", "onnxruntime"] == [one["settings"]["engine"] for one in data.values()]
    for name in ("psnr_white", "ssim"):
        assert data["onnxruntime"]["means"][name] == pytest.approx(data["torch"]["means"][name], abs=0.02)


@pytest.mark.slow
def test_truth_is_rendered_once_and_more_views_keep_it(by_hand, meshes, tiny_weights, tmp_path) -> None:
    def run(config: EvaluateConfig) -> int:
        before = len(by_hand)
        evaluate(meshes, tiny_weights, tmp_path / "out", config, tmp_path / "truth")
        return len(by_hand) - before

    assert run(CONFIG) == 4
    assert run(CONFIG) == run(replace(CONFIG, points=100, noise=0.01)) == 0
    assert run(replace(CONFIG, views=3)) == 2
    for change in ({"samples": 3}, {"bounces": 1}, {"elevation": 30.0}):
        assert run(replace(CONFIG, **change)) == 4
    write_mesh(meshes["gear"], *shape("vase"))
    assert run(CONFIG) == 2


def test_stored_truth_needs_no_blender(by_hand, meshes, tiny_weights, tmp_path, monkeypatch) -> None:
    first = metrics(evaluate(meshes, tiny_weights, tmp_path / "a", CONFIG, tmp_path / "truth"))
    monkeypatch.setattr(ground_truth, "render_scenes", render.render_scenes)
    monkeypatch.setattr(render, "_run_blender", lambda *_: pytest.fail("Blender was started"))
    second = metrics(evaluate(meshes, tiny_weights, tmp_path / "b", CONFIG, tmp_path / "truth"))
    assert first["means"]["ssim"] == second["means"]["ssim"]


def test_supersampled_pictures_are_drawn_larger_and_shrunk(by_hand, meshes, tiny_weights, tmp_path) -> None:
    plain, double = (
        metrics(evaluate(meshes, tiny_weights, tmp_path / str(factor), replace(CONFIG, supersample=factor), tmp_path))
        for factor in (1, 2)
    )
    assert len(by_hand) == 4  # the truth is the same
    assert [row["psnr_white"] for row in plain["rows"]] != [row["psnr_white"] for row in double["rows"]]
    with Image.open(tmp_path / "2" / "pictures" / "gear_0_0.png") as picture:
        assert picture.size == (SIDE, SIDE)


def test_elevation_is_configured_or_sampled(tiny_weights: Path) -> None:
    renderer = Renderer(tiny_weights)
    fixed = sample_views(renderer, "ab" * 32, replace(CONFIG, views=6, elevation=35.0))
    assert {view.scene.elevation for view in fixed} == {35.0} == {view.values["elevation"][0] for view in fixed}
    drawn = sample_views(renderer, "ab" * 32, replace(CONFIG, views=6, elevation=None))
    assert len({view.scene.elevation for view in drawn}) == 6
    assert all(view.scene.elevation == view.values["elevation"][0] for view in drawn)
    assert [view.scene.rotation for view in fixed] == [view.scene.rotation for view in drawn]
    assert len({view.scene.rotation for view in fixed}) == 6
    with pytest.raises(SettingError, match="elevation is 90, expected 0 to 80"):
        sample_views(renderer, "ab" * 32, replace(CONFIG, elevation=90.0))


def test_weights_without_elevation_are_measured_at_their_own(make_weights: Callable[..., Path]) -> None:
    renderer = Renderer(make_weights(("color", "light"), fixed_elevation=30.0))
    views = sample_views(renderer, "ab" * 32, replace(CONFIG, elevation=None))
    assert {view.scene.elevation for view in views} == {30.0} and "elevation" not in views[0].values
    with pytest.raises(SettingError, match="know only 30 degrees, got 20"):
        sample_views(renderer, "ab" * 32, CONFIG)


def test_cloud_is_rotated_and_lifted_with_the_mesh() -> None:
    quarter = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))  # about +Z: +X goes to +Y
    cloud = np.array([[1, 0, 0], [0, 0, -1]], dtype=np.float32)
    placed = place_in_scene(cloud, SceneDescription(rotation=quarter, lift=0.25))
    assert placed.dtype == np.float32
    assert placed == pytest.approx(np.array([[0, 1, 0.25], [0, 0, -0.75]]))


def test_metrics_without_pixels_are_null_and_not_averaged() -> None:
    complete = dict.fromkeys(METRIC_NAMES, 0.5) | {"mesh": "a", "seconds": 0.1}
    rows = [complete, complete | {"psnr_foreground": None}, complete | {"mesh": "b", "psnr_foreground": None}]
    summary = summarise(rows)
    assert summary["means"]["psnr_foreground"] == 0.5
    assert "psnr_foreground" not in summary["meshes"]["b"] and summary["meshes"]["b"]["ssim"] == 0.5


def test_impossible_evaluations_are_clear_errors(by_hand, meshes, tiny_weights, tmp_path) -> None:
    kept = tmp_path / "truth"
    with pytest.raises(ScanError, match="got none"):
        evaluate({}, tiny_weights, tmp_path / "out", CONFIG, kept)
    with pytest.raises(registry.PluginError, match="unknown sampler 'nosuch'"):
        evaluate(meshes, tiny_weights, tmp_path / "out", replace(CONFIG, sampler="nosuch"), kept)
    with pytest.raises(WeightsError, match="unknown weights 'nosuch'"):
        evaluate(meshes, "nosuch", tmp_path / "out", CONFIG, kept)
    assert not by_hand
    evaluate(meshes, tiny_weights, tmp_path / "out", CONFIG, kept)


def test_damaged_truth_is_quarantined_and_rendered_again(by_hand, meshes, tiny_weights, tmp_path):
    kept = tmp_path / "truth"
    evaluate(meshes, tiny_weights, tmp_path / "out", CONFIG, kept)
    broken = next(path for path in kept.glob("reference/*/*.png") if "coverage" not in path.name)
    sound = broken.read_bytes()
    broken.write_bytes(sound[:100])
    before = len(by_hand)
    evaluate(meshes, tiny_weights, tmp_path / "out", CONFIG, kept)
    assert len(by_hand) == before + 1 and broken.read_bytes() == sound
    assert len(list(kept.glob(".quarantine/reference/*"))) == 1


def test_many_rows_fill_several_sheets_and_old_ones_go(tmp_path: Path) -> None:
    picture = disc()[0].astype(np.float32) / 255
    cloud = np.random.default_rng(0).normal(size=(200, 3)).astype(np.float32) * 0.3
    row = make_row(("a mesh with a name far too long for its column 0", "SSIM 0.9"), cloud, 20.0, picture, picture)
    assert [cell.shape for cell in row.cells] == [(CELL_SIDE, CELL_SIDE, 3)] * 4
    assert (row.cells[0] < 200).any(axis=2).sum() > 100 and row.cells[1].max() > 100  # dots and splats are there
    assert np.array_equal(row.cells[2], row.cells[3])
    paths = write_sheets([row] * (2 * ROWS_PER_SHEET + 1), tmp_path)
    assert [path.name for path in paths] == ["sheet.png", "sheet_2.png", "sheet_3.png"]
    with Image.open(paths[0]) as first, Image.open(paths[2]) as last:
        assert first.width == last.width and first.height > 10 * CELL_SIDE and last.height < 2 * CELL_SIDE
    write_sheets([row], tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["sheet.png"]
    strangers = tmp_path / "sheet_2.png"
    picture_bytes = paths[0].read_bytes()
    Image.new("RGB", (8, 8)).save(strangers)
    before = strangers.read_bytes()
    write_sheets([row], tmp_path)
    with pytest.raises(SettingError, match=r"sheet_2\.png is there already"):
        write_sheets([row] * (ROWS_PER_SHEET + 1), tmp_path)
    assert strangers.read_bytes() == before and paths[0].read_bytes() == picture_bytes


@pytest.mark.slow
def test_clouds_lie_where_blender_draws_the_mesh(tmp_path: Path, tiny_weights: Path) -> None:
    """The dense cloud's splats cover the object in Blender's render: sphere, rotation and elevation agree."""
    path = tmp_path / "bent.ply"
    vertices, faces = shape("torus_knot")
    write_mesh(path, vertices * (1.0, 0.6, 1.4) + (30.0, -4.0, 2.0), faces)
    config = replace(CONFIG, views=1, resolution=64, points=1000, elevation=35.0)
    data = metrics(evaluate({"bent": path}, tiny_weights, tmp_path / "out", config, tmp_path / "truth"))
    assert np.isfinite(list(data["means"].values())).all()
    [covered] = (tmp_path / "truth").rglob("*.coverage.png")
    with Image.open(covered) as image:
        coverage = np.asarray(image) > 127
    [view] = sample_views(Renderer(tiny_weights), file_digest(path), config)
    mesh = read_mesh(path)
    sphere = bounding_sphere(mesh.vertices)
    cloud = sample_cloud(mesh, sphere, "uniform", 50_000, "none", 0.0, np.random.default_rng(0))
    pixels = np.floor(Camera(64, 64, 35.0).project(place_in_scene(cloud, view.scene))[0]).astype(int)
    splats = np.zeros((64, 64), dtype=bool)
    splats[pixels[:, 1], pixels[:, 0]] = True
    assert (splats & coverage).sum() / (splats | coverage).sum() > 0.85
    assert coverage.sum() > 200
