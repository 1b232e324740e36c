"""Baselines in an evaluation: their rows, pictures, times and errors, what is kept, and the true mesh's floor."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from z2p_core import registry
from z2p_core.camera import turn
from z2p_core.config import EvaluateConfig
from z2p_core.interfaces import Baseline, ScanError
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.quality.metrics import METRIC_NAMES
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.evaluation import baselines as module
from z2p_renderer.pipeline.evaluation import evaluate as evaluation
from z2p_renderer.pipeline.evaluation.baselines import run_baseline, run_baseline_on_scenes, with_true_floor
from z2p_renderer.pipeline.evaluation.evaluate import evaluate
from z2p_renderer.pipeline.render import RenderError, RenderSettings, render_mesh, render_scenes
from z2p_renderer.pipeline.rendering import ground_truth
from z2p_renderer.pipeline.rendering.views import place_in_scene
from z2p_renderer.pipeline.shapes import shape
from z2p_renderer.storage.meshes import Mesh
from z2p_renderer.storage.results.fingerprints import fingerprint, plugin_fields
from z2p_renderer.storage.scans.clouds import write_mesh

SIDE = 48
CONFIG = EvaluateConfig(views=2, points=300, resolution=SIDE, samples=2, denoise="off")
TRIANGLE = np.eye(3), np.array([[0, 1, 2]])


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Mesh | None, SceneDescription]]:
    """(mesh, scene) of each picture asked for; a square on a shadow stands in for Blender's renders."""
    asked: list[tuple[Mesh | None, SceneDescription]] = []

    def save_squares(mesh: Any, scenes: Any, out: Path, settings: object, log: object = None, name: str = "") -> None:
        out.mkdir(parents=True, exist_ok=True)
        picture, coverage = np.full((SIDE, SIDE, 4), 60, np.uint8), np.zeros((SIDE, SIDE), np.uint8)
        coverage[15:35, 15:35] = picture[15:35, 15:35, 3] = 255
        for stem, scene in scenes:
            if not (out / f"{stem}.png").exists():
                asked.append((mesh if isinstance(mesh, Mesh) else None, scene))
                Image.fromarray(picture).save(out / f"{stem}.png")
                Image.fromarray(coverage).save(out / f"{stem}.coverage.png")

    monkeypatch.setattr(ground_truth, "render_scenes", save_squares)
    monkeypatch.setattr(module, "render_mesh", save_squares)
    return asked


@pytest.fixture
def meshes(tmp_path: Path) -> dict[str, Path]:
    write_mesh(tmp_path / "vase.ply", *shape("vase"))
    return {"vase": tmp_path / "vase.ply"}


def run(meshes: dict[str, Path], weights: Path, folder: Path, config: EvaluateConfig, *names: str) -> dict[str, Any]:
    path = evaluate(meshes, weights, folder / "out", config, folder / "truth", baselines=names)
    data: dict[str, Any] = json.loads(path.read_text())
    return data


def test_each_baseline_has_rows_means_pictures_and_a_column(rendered, meshes, tiny_weights, tmp_path) -> None:
    alone = run(meshes, tiny_weights, tmp_path, CONFIG)
    with Image.open(tmp_path / "out" / "sheet.png") as sheet:
        width = sheet.width
    data = run(meshes, tiny_weights, tmp_path, CONFIG, "balls", "bpa")
    assert alone["baselines"] == {} and list(data["baselines"]) == ["balls", "bpa"]
    assert {**alone["rows"][0], "seconds": 0} == {**data["rows"][0], "seconds": 0}
    for theirs in data["baselines"].values():
        assert list(theirs) == ["means", "spread", "spread_over_seeds", "meshes", "seeds", "rows"]
        assert [(row["mesh"], row["view"]) for row in theirs["rows"]] == [("vase", 0), ("vase", 1)]
        assert set(theirs["means"]) == {*METRIC_NAMES, "seconds", "render_seconds"}
        assert theirs["means"]["psnr_white"] == 100 and "error" not in theirs["rows"][0]
    assert [one["name"] for one in data["settings"]["baselines"]] == ["balls", "bpa"]
    pictures = {path.name for path in (tmp_path / "out" / "pictures").iterdir()}
    assert pictures == {f"vase_0_{view}{name}.png" for view in (0, 1) for name in ("", "_balls", "_bpa")}
    with Image.open(tmp_path / "out" / "sheet.png") as sheet:
        assert sheet.width > 1.3 * width


def test_baselines_get_our_clouds_on_the_true_floor(rendered, meshes, tiny_weights, tmp_path, monkeypatch) -> None:
    given, plain = [], evaluation.place_in_scene
    monkeypatch.setattr(evaluation, "place_in_scene", lambda *pair: given.append(pair) or plain(*pair))
    run(meshes, tiny_weights, tmp_path, CONFIG, "balls")
    balls = [(mesh, scene) for mesh, scene in rendered if mesh is not None]
    assert len(balls) == 2
    for (mesh, scene), (cloud, ours) in zip(balls, given[::2], strict=True):
        centres = mesh.vertices.reshape(len(cloud), -1, 3).mean(axis=1)
        assert centres == pytest.approx(cloud, abs=1e-6) and mesh.smooth
        assert replace(scene, floor=None) == ours and ours.floor is None
        lowest = place_in_scene(cloud, ours)[:, 2].min()
        assert lowest - 0.2 < scene.floor <= lowest + 1e-6


def test_baseline_results_are_stored_by_all_their_inputs(rendered, meshes, tiny_weights, tmp_path) -> None:
    def new(config: EvaluateConfig, *names: str) -> int:
        before = len([mesh for mesh, _ in rendered if mesh is not None])
        run(meshes, tiny_weights, tmp_path, config, *names)
        return len([mesh for mesh, _ in rendered if mesh is not None]) - before

    assert new(CONFIG, "balls") == 2
    assert new(CONFIG, "balls") == 0 == new(CONFIG)
    assert new(replace(CONFIG, views=3), "balls") == 1
    for change in ({"points": 200}, {"noise": 0.01}, {"sampler": "grid"}, {"samples": 3}, {"elevation": 30.0}):
        assert new(replace(CONFIG, **change), "balls") == 2, change
    assert new(CONFIG, "balls", "bpa") == 2


def test_code_is_part_of_a_baseline_results_fingerprint(rendered, tmp_path, monkeypatch) -> None:
    balls, cloud = registry.load("baselines", "balls"), np.eye(3, dtype=np.float32)
    settings = RenderSettings((SIDE, SIDE))

    def made() -> int:
        before = len(rendered)
        run_baseline(balls, cloud, {}, np.random.default_rng(0), SceneDescription(), settings, tmp_path)
        return len(rendered) - before

    assert [made(), made()] == [1, 0]
    settings = replace(settings, threads=1)
    assert made() == 0
    monkeypatch.setattr(module, "cached_part_digest", lambda part: f"another {part}")
    assert made() == 1


def test_damaged_record_is_an_error_or_rendered_again(rendered, meshes, tiny_weights, tmp_path) -> None:
    run(meshes, tiny_weights, tmp_path, CONFIG, "balls")
    first, second = sorted((tmp_path / "truth").glob("*/*.json"))
    first.unlink()  # its picture is there, its times are not
    before = len(rendered)
    run(meshes, tiny_weights, tmp_path, CONFIG, "balls")
    assert len(rendered) == before + 1 and first.exists()
    second.write_text("{")
    with pytest.raises(RenderError, match="not a readable record"):
        run(meshes, tiny_weights, tmp_path, CONFIG, "balls")


def test_a_baseline_that_fails_counts_as_an_empty_picture(rendered, meshes, tiny_weights, tmp_path) -> None:
    for _ in range(2):  # once reconstructed, once kept
        data = run(meshes, tiny_weights, tmp_path, replace(CONFIG, points=3), "bpa", "balls")
        failed = data["baselines"]["bpa"]
        assert all("more than 16 points, got 3" in row["error"] for row in failed["rows"])
        assert all(row["seconds"] is None and row["render_seconds"] is None for row in failed["rows"])
        assert failed["means"]["alpha_l1"] > 0.1 and "seconds" not in failed["means"]
        assert data["baselines"]["balls"]["means"]["psnr_white"] == 100
    with Image.open(tmp_path / "out" / "pictures" / "vase_0_0_bpa.png") as picture:
        assert picture.mode == "RGBA" and not np.asarray(picture).any()


def test_a_baseline_that_breaks_its_contract_is_named(tmp_path: Path) -> None:
    class Broken(Baseline):
        name, version = "broken", "1"

        def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
            return TRIANGLE[0], TRIANGLE[1] + 1

    with pytest.raises(registry.PluginError, match="baseline 'broken': expected finite vertices"):
        run_baseline(Broken, np.eye(3), {}, np.random.default_rng(0), SceneDescription(), RenderSettings(), tmp_path)
    assert plugin_fields(Broken)["name"] == "broken"


def test_bad_arguments_fail_before_the_first_render(rendered, meshes, tiny_weights, tmp_path) -> None:
    with pytest.raises(registry.PluginError, match="unknown baseline 'nosuch'"):
        run(meshes, tiny_weights, tmp_path, CONFIG, "balls", "nosuch")
    (tmp_path / "broken.ply").write_bytes(b"ply\n")
    with pytest.raises(ScanError, match=r"broken\.ply"):
        run({**meshes, "broken": tmp_path / "broken.ply"}, tiny_weights, tmp_path, CONFIG)
    assert not rendered


def test_scene_floor_survives_json() -> None:
    scene, on_floor = SceneDescription(), SceneDescription(floor=-0.5)
    assert "floor" not in scene.to_json() and on_floor.to_json() == scene.to_json() | {"floor": -0.5}
    for one in (scene, on_floor):
        assert SceneDescription.from_json(json.loads(json.dumps(one.to_json()))) == one
    assert SceneDescription.from_json(scene.to_json() | {"floor": None}) == scene
    assert fingerprint(scene.to_json())[:16] == "f6a9084da504a8bc"  # the key of pictures made before


@pytest.mark.slow
def test_partial_mesh_is_rendered_on_the_true_floor(tmp_path: Path) -> None:
    """Without a floor of the whole mesh, its upper half would stand on one of its own, in another picture."""
    vertices, faces = shape("vase")
    path = tmp_path / "vase.ply"
    write_mesh(path, vertices, faces)
    rotation = tuple(map(tuple, (turn(30.0) @ np.array([[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]])).tolist()))
    scene = SceneDescription(rotation=rotation)
    settings = RenderSettings((SIDE, SIDE), samples=4, denoise="off", threads=1)
    render_scenes(path, [("truth", scene)], tmp_path, settings)
    whole = bounding_sphere(vertices).normalise(vertices)
    floored = with_true_floor(scene, whole)
    height = whole[faces].mean(axis=1) @ np.array(rotation)[2]
    half = Mesh(whole, faces[height > 0], smooth=True)
    used = np.unique(half.faces)
    half = Mesh(whole[used], np.searchsorted(used, half.faces), smooth=True)
    render_mesh(half, [("high", floored), ("low", scene)], tmp_path, settings)
    render_mesh(Mesh(whole, faces, smooth=True), [("same", replace(scene, floor=floored.floor))], tmp_path, settings)

    def shadow(stem: str) -> np.ndarray:
        alpha, coverage = (np.asarray(Image.open(tmp_path / name)) for name in (f"{stem}.png", f"{stem}.coverage.png"))
        return np.where(coverage == 0, alpha[..., 3], 0).astype(float)

    rows = np.arange(SIDE)[:, None]
    high, low = ((shadow(stem) * rows).sum() / shadow(stem).sum() for stem in ("high", "low"))
    assert high > low + 2  # pixels further down
    assert np.abs(shadow("same") - shadow("truth")).mean() < 8  # Cycles' noise: the stems, so the seeds, differ


@pytest.mark.slow
def test_real_renders_come_near_the_truth(meshes, tiny_weights, tmp_path) -> None:
    """The balls leave gaps, a surface hardly any: mesh, sphere, rotation and floor agree with the truth's."""
    config = replace(CONFIG, views=1, points=2000, samples=8)
    data = run(meshes, tiny_weights, tmp_path, config, "balls", "bpa")
    balls, bpa = (data["baselines"][name]["means"] for name in ("balls", "bpa"))
    assert bpa["alpha_l1"] < 0.04 and bpa["psnr_white"] > 22 and bpa["render_seconds"] > 0
    assert balls["psnr_white"] < bpa["psnr_white"]
    inside = np.asarray(Image.open(next((tmp_path / "truth" / "reference").rglob("*.coverage.png")))) == 255
    assert (np.asarray(Image.open(tmp_path / "out" / "pictures" / "vase_0_0_balls.png"))[inside, 3] > 0).mean() > 0.5
    assert run(meshes, tiny_weights, tmp_path, config, "balls", "bpa")["baselines"] == data["baselines"]


@pytest.mark.parametrize("seen_from", [False, True])
def test_interrupted_run_resumes_with_the_same_results(rendered, tmp_path, seen_from: bool) -> None:
    class Chancy(Baseline):
        name, version, for_view = "chancy", "1", seen_from

        def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
            return rng.normal(size=(3, 3)), TRIANGLE[1]

        def reconstruct_for(self, cloud, viewer, rng):
            return self.reconstruct(cloud, rng)

    scenes = [replace(SceneDescription(), elevation=float(angle)) for angle in (10, 30, 50)]

    def meshes_of(asked: list[SceneDescription], root: Path) -> dict[float, np.ndarray]:
        rendered.clear()
        settings = RenderSettings(resolution=(SIDE, SIDE))
        run_baseline_on_scenes(Chancy, np.eye(3), {}, np.random.default_rng(0), asked, settings, root)
        return {scene.elevation: mesh.vertices for mesh, scene in rendered}

    whole = meshes_of(scenes, tmp_path / "whole")
    part = meshes_of(scenes[:1], tmp_path / "part") | meshes_of(scenes, tmp_path / "part")
    assert part.keys() == whole.keys() and len({mesh.tobytes() for mesh in whole.values()}) == (3 if seen_from else 1)
    assert all(np.array_equal(part[angle], mesh) for angle, mesh in whole.items())
