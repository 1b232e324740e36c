"""Measures the times of the paper's Tables 2 and 3 on this machine, in one run, one after the other."""

from __future__ import annotations

import json
import os
import platform
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.camera import Camera, turn
from z2p_core.config.report import ReportConfig
from z2p_core.interfaces import Engine, ScanError
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.evaluation.baselines import load_baselines
from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import SYNTHETIC_SETTINGS, UNIT_SPHERE, VIEW_CONTROLS, TrueMesh
from z2p_renderer.pipeline.evaluation.paper.methods import BASELINE, WEIGHTS, Method
from z2p_renderer.pipeline.inference.engine_selection import start_engine
from z2p_renderer.pipeline.inference.loading import LoadedWeights, load_plugins
from z2p_renderer.pipeline.render import RenderSettings, render_mesh
from z2p_renderer.pipeline.rendering.mesh_samples import sample_cloud
from z2p_renderer.pipeline.rendering.views import describe, load_controls, place_in_scene
from z2p_renderer.storage.meshes import Mesh
from z2p_renderer.storage.models.checkpoints import find_weights

WIDTH = 500
HEIGHT = 313
"""Size of the paper's pictures, pixels."""
BATCH_SIZES = (1, 2, 3, 4, 5, 6)
TIMES_FILE = "times.json"
Log = Callable[[str], None]


def measure_times(
    subject: TrueMesh, methods: Sequence[Method], config: ReportConfig, out: Path, log: Log = lambda line: None
) -> Path:
    """Writes ``out/times.json``: seconds of each step, medians over the repeats, and a description of the machine.

    Raises:
        WeightsError, PluginError: a method cannot be used.
        RenderError: Blender failed.
    """
    rng = np.random.default_rng([config.seed, 6])
    cloud = sample_cloud(subject.mesh, UNIT_SPHERE, "uniform", config.points, "none", 0.0, rng)
    scene = describe(load_controls(VIEW_CONTROLS), SYNTHETIC_SETTINGS, turn(25.0))
    record: dict[str, Any] = {
        "mesh": subject.name, "points": config.points, "resolution": [WIDTH, HEIGHT], "repeats": config.time_repeats,
        "cycles_samples": config.samples, "machine": _describe_machine(), "weights": {}, "baselines": {},
    }  # fmt: skip
    for method in methods:
        if method.kind == WEIGHTS:
            record["weights"][method.name] = _time_weights(
                method, place_in_scene(cloud, scene), scene, config.time_repeats
            )
        elif method.kind == BASELINE:
            record["baselines"][method.name] = _time_baseline(method, cloud, scene, config)
        log(f"times: {method.name} done")
    path = out / TIMES_FILE
    path.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return path


def _time_weights(method: Method, cloud: np.ndarray, scene: SceneDescription, repeats: int) -> dict[str, Any]:
    """A row per batch size, on the engine that users get by default."""
    file = find_weights(method.source)
    loaded = load_plugins(file)
    engine = start_engine(loaded, file)
    rows = [_time_batch(loaded, engine, cloud, scene, batch, repeats) for batch in BATCH_SIZES]
    return {"engine": engine.name, "rows": rows}


def _time_batch(
    loaded: LoadedWeights, engine: Engine, cloud: np.ndarray, scene: SceneDescription, batch: int, repeats: int
) -> dict[str, float]:
    """Seconds of each step for a batch; buffers are drawn one picture at a time, as the paper does."""
    camera, steps = Camera(WIDTH, HEIGHT, scene.elevation), {}
    shape = (batch, loaded.buffer_channels, HEIGHT, WIDTH)
    buffers, split = np.empty(shape, np.float32), loaded.zbuffer.channels
    encoding = loaded.encoder.encode(*camera.frame_coordinates(step=loaded.config.unshuffle))
    values = {name: SYNTHETIC_SETTINGS.get(name, control.slider.default) for name, control in loaded.controls.items()}
    encoded = [number for name, value in values.items() for number in loaded.controls[name].encode(value)]
    settings = np.tile(np.array([encoded], np.float32), (batch, 1))

    def draw_z() -> None:
        for picture in buffers:
            loaded.zbuffer.draw_into(picture[:split], cloud, camera)

    def draw_g() -> None:
        for picture in buffers:
            loaded.gbuffer.draw_into(picture[split:], cloud, camera, scene)

    steps["project"] = _median_seconds(lambda: [camera.project(cloud) for _ in range(batch)], repeats)
    steps["zbuffer"] = _median_seconds(draw_z, repeats)
    steps["gbuffer"] = _median_seconds(draw_g, repeats) if loaded.gbuffer.channels else 0.0
    steps["forward"] = _median_seconds(lambda: engine.draw(buffers, encoding, settings), repeats)
    per_picture = (steps["zbuffer"] + steps["gbuffer"] + steps["forward"]) / batch
    return {"batch": batch, **{name: round(taken, 6) for name, taken in steps.items()}, "each": round(per_picture, 6)}


def _time_baseline(method: Method, cloud: np.ndarray, scene: SceneDescription, config: ReportConfig) -> dict[str, Any]:
    """Seconds of a baseline's steps, of the whole reconstruction, and of Blender; of a painter's steps."""
    plugin = load_baselines([method.source])[method.source]
    placed = place_in_scene(cloud, scene)
    runs = []
    for _ in range(config.time_repeats + 1):  # the first run imports libraries and is dropped
        instance, started = plugin(), time.perf_counter()
        try:
            result = (
                instance.reconstruct_for(placed, Camera(1, 1).position, np.random.default_rng(0))
                if hasattr(instance, "reconstruct_for")
                else instance.paint(placed, Camera(WIDTH, HEIGHT, scene.elevation), scene)
            )
        except ScanError as error:
            return {"error": str(error)}
        runs.append((time.perf_counter() - started, dict(instance.seconds)))
    total_seconds = statistics.median(taken for taken, _ in runs[1:])
    steps = {name: round(statistics.median(run[1][name] for run in runs[1:]), 6) for name in runs[-1][1]}
    record: dict[str, Any] = {"steps": steps, "whole": round(total_seconds, 6), "render": 0.0}
    if isinstance(result, tuple):
        settings = RenderSettings((WIDTH, HEIGHT), config.samples, config.denoise, seed=config.seed)
        upright = SceneDescription(scene.elevation, scene.light, scene.material)
        with tempfile.TemporaryDirectory(prefix="z2p-times-") as folder:
            started = time.perf_counter()
            mesh = Mesh(result[0], result[1], smooth=True)
            render_mesh(mesh, [("picture", upright)], Path(folder), settings, name=method.name)
            record["render"] = round(time.perf_counter() - started, 6)
    return record | {"total": round(total_seconds + record["render"], 6)}


def _median_seconds(call: Callable[[], object], repeats: int) -> float:
    """Median seconds of a call, after one warm-up."""
    call()
    taken = []
    for _ in range(repeats):
        started = time.perf_counter()
        call()
        taken.append(time.perf_counter() - started)
    return statistics.median(taken)


def _describe_machine() -> dict[str, Any]:
    """What the times depend on: processor, cores, load and number of threads."""
    return {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count(),
            "load_average": [round(load, 2) for load in os.getloadavg()],
            "omp_num_threads": os.environ.get("OMP_NUM_THREADS", "")}  # fmt: skip
