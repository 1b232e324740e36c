"""Baselines over several scenes, and painters: number of reconstructions, viewpoints, and stored results."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from PIL import Image

from z2p_core import registry
from z2p_core.camera import Camera, turn
from z2p_core.interfaces import Baseline, Painter, ScanError
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.evaluation import baselines as module
from z2p_renderer.pipeline.evaluation.baselines import load_baselines, run_baseline_on_scenes, viewer_position
from z2p_renderer.pipeline.render import RenderSettings

SETTINGS = RenderSettings((40, 32), samples=1)
CLOUD = np.random.default_rng(0).uniform(-0.5, 0.5, (60, 3)).astype(np.float32)


def scene(azimuth: float = 0.0, light: float = 0.0, lift: float = 0.0) -> SceneDescription:
    rotation = tuple(map(tuple, turn(azimuth).tolist()))
    return SceneDescription(light=(3.5, light, 50.0), rotation=rotation, lift=lift, floor=-0.5)


SCENES = [scene(), scene(light=40.0), scene(azimuth=90.0)]


class Counting(Baseline):
    name, version = "counting", "1"
    calls: ClassVar[list[np.ndarray | None]] = []

    def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        self.calls.append(None)
        with self.timed("think"):
            return cloud[:3].astype(float), np.array([[0, 1, 2]])


class Seeing(Counting):
    name, for_view = "seeing", True

    def reconstruct_for(self, cloud: np.ndarray, viewer: np.ndarray, rng: Any) -> tuple[np.ndarray, np.ndarray]:
        self.calls.append(viewer)
        return cloud[:3].astype(float), np.array([[0, 1, 2]])


class Marking(Painter):
    """White where the cloud's middle is."""

    name, version = "marking", "1"

    def paint(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        if len(cloud) < 50:
            raise ScanError("too few")
        picture = np.zeros((camera.height, camera.width, 4), np.float32)
        (x, y), _ = (found[0] for found in camera.project(cloud.mean(0, keepdims=True).astype(float)))
        picture[int(y), int(x)] = 1
        return picture


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Pictures requested of each Blender process; grey ones stand in for its renders."""
    requested: list[int] = []

    def save(mesh: object, jobs: Any, out: Path, settings: RenderSettings, **more: object) -> None:
        requested.append(len(jobs))
        for stem, _ in jobs:
            Image.fromarray(np.full((32, 40, 4), 90, np.uint8)).save(out / f"{stem}.png")

    monkeypatch.setattr(module, "render_mesh", save)
    monkeypatch.setattr(module, "_warm_up", lambda competitor: None)
    Counting.calls.clear()
    return requested


def run(
    competitor: Any, root: Path, scenes: list[SceneDescription], cloud: np.ndarray = CLOUD
) -> list[module.BaselineResult]:
    return run_baseline_on_scenes(
        competitor, cloud, {"n": len(cloud)}, np.random.default_rng(0), scenes, SETTINGS, root
    )


def test_one_reconstruction_serves_all_missing_scenes(rendered: list[int], tmp_path: Path) -> None:
    results = run(Counting, tmp_path, SCENES)
    assert len(Counting.calls) == 1 and rendered == [3]
    assert all(one.picture.shape == (32, 40, 4) and one.steps["think"] >= 0 for one in results)
    run(Counting, tmp_path, [*SCENES, scene(lift=0.2)])
    assert len(Counting.calls) == 2 and rendered == [3, 1]


def test_concurrent_runs_reconstruct_once(rendered: list[int], tmp_path: Path) -> None:
    """As tasks side by side do, whose sweeps share the plain case."""
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: run(Counting, tmp_path, SCENES), range(4)))
    assert len(Counting.calls) == 1 and rendered == [3]
    assert len({one.picture.tobytes() for results in found for one in results}) == 1


def test_view_dependent_baseline_runs_once_per_viewpoint(rendered: list[int], tmp_path: Path) -> None:
    run(Seeing, tmp_path, SCENES)
    assert rendered == [2, 1]
    for viewer, seen_in in zip(Seeing.calls, (SCENES[0], SCENES[2]), strict=True):
        assert viewer is not None and viewer == pytest.approx(viewer_position(seen_in))


def test_viewer_position_is_the_cameras() -> None:
    lifted = replace(scene(azimuth=70.0, lift=0.3), elevation=35.0)
    back = np.array(lifted.rotation) @ viewer_position(lifted) + (0, 0, 0.3)
    assert back == pytest.approx(Camera(1, 1, 35.0).position)


def test_painter_gets_the_cloud_placed_in_the_scene(rendered: list[int], tmp_path: Path) -> None:
    cloud = CLOUD + np.array([0.4, 0.0, 0.0], np.float32)
    right, front = run(Marking, tmp_path, [scene(), scene(azimuth=90.0)], cloud)
    columns = [int(np.argwhere(one.picture[..., 3])[0][1]) for one in (right, front)]
    assert columns[0] > columns[1] + 2 and rendered == []
    assert right.render_seconds == 0 and right.seconds is not None
    again = run(Marking, tmp_path, [scene()], cloud)[0]
    assert again.picture.tobytes() == right.picture.tobytes() and again.seconds == right.seconds


def test_failing_painter_gives_an_empty_picture(rendered: list[int], tmp_path: Path) -> None:
    one = run(Marking, tmp_path, [scene()], CLOUD[:10])[0]
    assert one.error == "too few" and not one.picture.any() and one.seconds is None


def test_a_painter_that_breaks_its_contract_is_named(rendered: list[int], tmp_path: Path) -> None:
    class Broken(Painter):
        name, version = "broken", "1"

        def paint(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
            return np.full((camera.height, camera.width, 4), 2.0, np.float32)

    with pytest.raises(registry.PluginError, match=r"painter 'broken': expected .* from 2 to 2"):
        run(Broken, tmp_path, [scene()])


def test_painters_are_found_beside_baselines() -> None:
    found = load_baselines(["bpa", "screen"])
    assert issubclass(found["bpa"], Baseline) and issubclass(found["screen"], Painter)
