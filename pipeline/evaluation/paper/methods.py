"""The compared methods behind one interface: weights (the network), baselines and painters."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core import registry
from z2p_core.config.report import ReportConfig
from z2p_core.images import unit_from_bytes
from z2p_core.interfaces import PointColors
from z2p_renderer.pipeline.evaluation.baselines import load_baselines, run_baseline_on_scenes, with_true_floor
from z2p_renderer.pipeline.evaluation.paper.cases.ground_truth import report_render_settings
from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import Case
from z2p_renderer.pipeline.inference.engine_selection import REFERENCE_ENGINE
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.rendering.textures import SeededTexture
from z2p_renderer.pipeline.rendering.views import place_in_scene
from z2p_renderer.storage.models.checkpoints import find_weights
from z2p_renderer.storage.results.fingerprints import file_digest, plugin_fields

Log = Callable[[str], None]

WEIGHTS = "weights"
BASELINE = "baseline"
TRUTH = "truth"


@dataclass(frozen=True)
class Method:
    """A method's name in the report, its kind, and its source: the name of a plugin, or of weights or their file."""

    name: str
    kind: str
    source: str


@dataclass(frozen=True)
class MethodImage:
    """A method's picture of a case: (H, W, 4) float32 in [0, 1], or None if it cannot draw the case."""

    picture: np.ndarray | None
    seconds: float | None = None
    steps: Mapping[str, float] = field(default_factory=dict)
    error: str = ""


def draw_cases(
    method: Method, cases: Sequence[Case], config: ReportConfig, root: Path, log: Log = lambda line: None
) -> list[MethodImage]:
    """A method's pictures of cases; renders of baselines are stored under `root`, beside the ground truth.

    Raises:
        WeightsError, PluginError: the method cannot be used.
        RenderError: Blender failed, or a stored render is damaged.
    """
    if method.kind == WEIGHTS:
        return [draw_case(method, case, config) for case in cases]
    drawn: list[MethodImage | None] = [None] * len(cases)
    groups: dict[tuple[str, SeededTexture | None], list[int]] = {}
    for index, case in enumerate(cases):
        groups.setdefault((cloud_digest(case.cloud), case.texture), []).append(index)
    competitor = load_baselines([method.source])[method.source]
    for (digest, _), indices in groups.items():
        scenes = [with_true_floor(cases[index].scene, cases[index].truth.vertices) for index in indices]
        rng = np.random.default_rng([config.seed, 5])
        first = cases[indices[0]]
        results = run_baseline_on_scenes(
            competitor, first.cloud, {"sha256": digest}, rng, scenes, report_render_settings(config), root, log,
            first.albedo,
        )  # fmt: skip
        for index, one in zip(indices, results, strict=True):
            steps = {**one.steps, "render": one.render_seconds or 0.0}
            drawn[index] = MethodImage(one.picture, one.seconds, steps, one.error)
    return [one for one in drawn if one is not None]


def draw_case(method: Method, case: Case, config: ReportConfig, cloud: np.ndarray | None = None) -> MethodImage:
    """The weights' picture of a case, optionally with another cloud."""
    renderer = load_renderer(find_weights(method.source))
    missing = [name for name in case.required_controls if name not in renderer.controls]
    if missing:
        return MethodImage(None, error=f"these weights do not carry {' and '.join(missing)}")
    albedo = case.albedo
    if albedo is not None and not renderer.draws_colors:
        return MethodImage(None, error="these weights draw no colours of points")
    placed = place_in_scene(case.cloud if cloud is None else cloud, case.scene)
    colors = None if albedo is None else PointColors(place_in_scene(case.cloud, case.scene), albedo)
    floor = with_true_floor(case.scene, case.truth.vertices).floor
    values = {name: value for name, value in case.values.items() if name in renderer.controls}
    started = time.perf_counter()
    picture = renderer.render(placed, values, config.resolution, config.resolution, floor, colors)
    return MethodImage(unit_from_bytes(picture), round(time.perf_counter() - started, 4))


def load_renderer(file: Path) -> Renderer:
    """The weights of a file on the reference engine; loaded once per process and content."""
    return _loaded(file, file_digest(file))


@lru_cache(maxsize=4)
def _loaded(file: Path, digest: str) -> Renderer:
    renderer = Renderer(file, engine=REFERENCE_ENGINE)
    elevation = renderer.fixed_elevation
    renderer.render(np.zeros((1, 3), np.float32), None, 64, 64, 0.0 if elevation is None else -0.1)  # warm-up
    return renderer


def cloud_digest(cloud: np.ndarray) -> str:
    """sha256 (64 hex digits) of a cloud (N, 3) in float32."""
    return hashlib.sha256(np.ascontiguousarray(cloud, np.float32).tobytes()).hexdigest()


def method_fields(method: Method) -> dict[str, Any]:
    """Fingerprint fields of the method's pictures."""
    if method.kind == TRUTH:
        return {"kind": TRUTH}
    if method.kind == BASELINE:
        return {"kind": BASELINE, "plugin": plugin_fields(load_baselines([method.source])[method.source])}
    loaded = load_plugins(find_weights(method.source))
    plugins = [registry.load("engines", REFERENCE_ENGINE), type(loaded.zbuffer), type(loaded.gbuffer),
               type(loaded.encoder), *map(type, loaded.controls.values())]  # fmt: skip
    digest = file_digest(find_weights(method.source))
    return {"kind": WEIGHTS, "sha256": digest, "plugins": [plugin_fields(plugin) for plugin in plugins]}
