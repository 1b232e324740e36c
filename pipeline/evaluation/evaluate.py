"""Measures weights: their pictures of clouds sampled on meshes, against Blender's renders of these meshes."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from z2p_core import registry
from z2p_core.config import EvaluateConfig, to_dict
from z2p_core.images import bytes_from_unit, shrink, unit_from_bytes
from z2p_core.interfaces import PointColors, ScanError, SettingError
from z2p_core.placement.bounding_sphere import Sphere, bounding_sphere
from z2p_core.quality.metrics import METRIC_NAMES, image_metrics
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.evaluation.baselines import load_baselines, run_baseline, with_true_floor
from z2p_renderer.pipeline.evaluation.comparison_sheet import SheetRow, make_row, write_sheets
from z2p_renderer.pipeline.evaluation.time_limit import StoppableProcess
from z2p_renderer.pipeline.inference.engine_selection import REFERENCE_ENGINE
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.render import RenderSettings, read_render
from z2p_renderer.pipeline.rendering.ground_truth import render_references
from z2p_renderer.pipeline.rendering.mesh_samples import sample_cloud
from z2p_renderer.pipeline.rendering.textured_truth import render_textured_references
from z2p_renderer.pipeline.rendering.textures import mesh_texture
from z2p_renderer.pipeline.rendering.views import View, describe, place_in_scene, sample_view, view_rng
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.meshes import Mesh, read_mesh
from z2p_renderer.storage.models.checkpoints import find_weights
from z2p_renderer.storage.results.fingerprints import file_digest, plugin_fields, stage_fields

if TYPE_CHECKING:
    from z2p_core.interfaces import Baseline

UPRIGHT_SHARE = 0.5
"""Share of the views that rotate the mesh about +Z only, as in training."""
STOPPED_AFTER = "stopped_after"
"""Key in the row of a baseline that was stopped: the seconds that it was given."""
WEIGHTS_KEY = ""
"""Key of the weights among the methods; the baselines' keys are their names."""

Log = Callable[[str], None]
Result = tuple[dict[str, Any], np.ndarray]
"""Row of metrics, and the measured picture: (H, W, 4) float32 in [0, 1], straight sRGB RGBA."""


@dataclass(frozen=True)
class EvaluationMesh:
    """A mesh to evaluate on; `identity` is the sha256 of its file, `sphere` the mesh's bounding sphere."""

    name: str
    path: Path
    identity: str
    mesh: Mesh
    sphere: Sphere


@dataclass(frozen=True)
class Trial:
    """One view of a mesh for one seed: the cloud that methods get, and the render that they should reproduce.

    `cloud` (N, 3) float32 lies in the unit sphere, before the scene rotates it. `truth` (H, W, 4) is straight sRGB
    RGBA, `coverage` (H, W) the object's share of each pixel; both float32 in [0, 1]. With a `texture`, the mesh has its
    colors, and `albedo` (N, 3) float32 are those of the points, linear: the texture's where the points are.
    """

    subject: EvaluationMesh
    config: EvaluateConfig
    index: int
    view: View
    cloud: np.ndarray
    truth: np.ndarray
    coverage: np.ndarray
    texture: str = ""
    albedo: np.ndarray | None = None


def evaluate(
    meshes: Mapping[str, Path],
    weights: str | Path,
    out: Path,
    config: EvaluateConfig,
    truth_root: Path,
    log: Log = lambda line: None,
    baselines: Sequence[str] = (),
    engine: str = REFERENCE_ENGINE,
    baseline_seconds: float | None = None,
) -> Path:
    """Writes ``out/metrics.json`` (a row per mesh, view and seed; means; spread), pictures and comparison sheets.

    With `config.textures`, meshes and clouds are drawn in the colors of each of them instead of the control's; there is
    a row for each, and the means are given for each and for all.

    Views and clouds depend on the seed, the mesh's bytes and the view's number, not on names or other meshes.
    Each of `baselines` gets the same clouds, and its own rows and means under its name. Ground truth and baselines'
    pictures are stored under `truth_root` by their fingerprint and reused for other weights. `engine` runs the network.
    A baseline that takes longer than `baseline_seconds` for a cloud is stopped, as are its other clouds of this mesh;
    its rows say ``stopped_after``, and its means are of the clouds that it did.

    Raises:
        ScanError: no meshes, or one that cannot be read.
        WeightsError, PluginError: the weights, the engine or a needed plugin cannot be used.
        SettingError: an elevation that the weights were not trained for, or textures that they cannot draw.
        RenderError: Blender failed, or a stored render is damaged.
    """
    if not meshes:
        raise ScanError("expected meshes to evaluate on, got none; give a folder with at least one")
    registry.load("samplers", config.sampler)  # an unknown sampler fails before the first render
    competitors = load_baselines(baselines)
    renderer = Renderer(weights, engine=engine)
    _check_textures(renderer, config)
    evaluation_meshes = [_load_evaluation_mesh(name, path) for name, path in meshes.items()]  # so does a broken mesh
    (out / "pictures").mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in (WEIGHTS_KEY, *competitors)}
    sheet: list[SheetRow] = []
    trials = (
        _trials(mesh, renderer, one_seed, truth_root, log)
        for one_seed in split_seeds(config) for mesh in evaluation_meshes
    )  # fmt: skip
    with nullcontext() if baseline_seconds is None else StoppableProcess(baseline_seconds) as process:
        for trial in chain.from_iterable(trials):
            results = {WEIGHTS_KEY: _run_weights(renderer, trial)}
            for name, competitor in competitors.items():
                earlier = _earlier_stop(rows[name], trial)
                results[name] = earlier or _run_baseline(competitor, trial, truth_root, log, process)
            for name, (row, _) in results.items():
                rows[name].append(row)
            _save_pictures(trial, results, out / "pictures", log)
            sheet.append(_sheet_row(trial, results))
    write_sheets(sheet, out, tuple(competitors))
    settings = _settings(config, weights, engine, evaluation_meshes, competitors)
    summaries = {name: {**summarise(own), **_summarise_textures(own), "rows": own} for name, own in rows.items()}
    ours = summaries.pop(WEIGHTS_KEY)
    return _write_json(out / "metrics.json", {"settings": settings, **ours, "baselines": summaries})


def _check_textures(renderer: Renderer, config: EvaluateConfig) -> None:
    """None where the textures are installed and the weights can draw colors of points, or none are asked for.

    Raises:
        SettingError: the weights draw one color.
        PluginError: a texture is unknown or broken.
    """
    for name in config.textures:
        registry.load("textures", name)
    if config.textures and not renderer.draws_colors:
        raise SettingError("textures: expected weights that draw colours of points, got ones that draw one colour; "
                           "leave textures out, or take other weights")  # fmt: skip


def split_seeds(config: EvaluateConfig) -> list[EvaluateConfig]:
    """One config per seed that `config` measures."""
    return [replace(config, seed=config.seed + number, seeds=1) for number in range(config.seeds)]


def _settings(
    config: EvaluateConfig,
    weights: str | Path,
    engine: str,
    evaluation_meshes: Sequence[EvaluationMesh],
    competitors: Mapping[str, type[Baseline]],
) -> dict[str, Any]:
    """The settings of the evaluation, as `metrics.json` records them."""
    return {
        "config": to_dict(config),
        "weights": {"name": Path(weights).name, "sha256": file_digest(find_weights(weights))},
        "engine": engine,
        "meshes": {subject.name: subject.identity for subject in evaluation_meshes},
        "baselines": [plugin_fields(plugin) for plugin in competitors.values()],
        **({"textures": [plugin_fields(registry.load("textures", name)) for name in config.textures]}
           if config.textures else {}),
    }  # fmt: skip


def sample_views(renderer: Renderer, identity: str, config: EvaluateConfig) -> list[View]:
    """Random views of the mesh with content digest `identity`; `config.elevation` of None draws that too.

    Raises:
        SettingError: an elevation that the weights were not trained for.
    """
    controls, elevation = renderer.controls, config.elevation
    if "elevation" not in controls:
        fixed = renderer.fixed_elevation
        if elevation is not None and fixed is not None and not math.isclose(elevation, fixed):
            raise SettingError(f"elevation: these weights know only {fixed:g} degrees, got {elevation:g}")
        elevation = fixed
    views = []
    for index in range(config.views):
        view = sample_view(controls, view_rng(config.seed, identity, index), UPRIGHT_SHARE)
        values, scene = dict(view.values), view.scene
        if elevation is not None:
            if "elevation" in controls:
                values["elevation"] = controls["elevation"].check((elevation,))
            scene = describe(controls, values, np.array(scene.rotation))
            scene.elevation = elevation
        views.append(View(scene, values))
    return views


def render_ground_truth(
    subject: EvaluationMesh, scenes: Sequence[SceneDescription], config: EvaluateConfig, truth_root: Path, log: Log
) -> list[Path]:
    """Path of each scene's picture (its coverage beside it); renders those that `truth_root` lacks.

    More views, or other weights with the same controls, reuse what is stored.
    """
    return render_references(subject.path, subject.identity, scenes, ground_truth_settings(config), truth_root, log)


def summarise(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means, spread (standard deviation over rows), means per mesh and per seed, and the spread over seeds.

    Each metric is taken over the rows that have it.
    """
    groups: dict[str, dict[Any, list[Mapping[str, Any]]]] = {"mesh": {}, "seed": {}}
    for row in rows:
        for key, group in groups.items():
            group.setdefault(row.get(key, 0), []).append(row)
    meshes, seeds = ({name: _aggregate(own, np.mean) for name, own in group.items()} for group in groups.values())
    spread = _aggregate(list(seeds.values()), np.std)
    return {
        "means": _aggregate(rows, np.mean), "spread": _aggregate(rows, np.std), "spread_over_seeds": spread,
        "meshes": meshes, "seeds": seeds, **_count_stopped(rows),
    }  # fmt: skip


def _count_stopped(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """``stopped``: how many rows were stopped, of how many, and the seconds that they were given; nothing if none."""
    seconds = [row[STOPPED_AFTER] for row in rows if STOPPED_AFTER in row]
    return {"stopped": {"rows": len(seconds), "of": len(rows), "after_seconds": max(seconds)}} if seconds else {}


def _summarise_textures(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """``textures``: what `summarise` gives for the rows of each texture; nothing if there are none."""
    kinds = dict.fromkeys(row["texture"] for row in rows if "texture" in row)
    by_kind = {kind: summarise([row for row in rows if row["texture"] == kind]) for kind in kinds}
    return {"textures": by_kind} if by_kind else {}


def _load_evaluation_mesh(name: str, path: Path) -> EvaluationMesh:
    mesh = read_mesh(path)
    return EvaluationMesh(name, path, file_digest(path), mesh, bounding_sphere(mesh.vertices))


def _trials(
    subject: EvaluationMesh, renderer: Renderer, config: EvaluateConfig, truth_root: Path, log: Log
) -> Iterator[Trial]:
    views = sample_views(renderer, subject.identity, config)
    for texture in config.textures or ("",):
        scenes = [view.scene for view in views]
        truth = _render_truth(subject, texture, scenes, config, truth_root, log)
        yield from _texture_trials(subject, texture, config, views, truth)


def _render_truth(
    subject: EvaluationMesh, texture: str, scenes: Sequence[SceneDescription], config: EvaluateConfig, root: Path,
    log: Log,
) -> list[Path]:  # fmt: skip
    """Path of each scene's picture in a texture, or in the scene's own color if it is empty."""
    if not texture:
        return render_ground_truth(subject, scenes, config, root, log)
    placed = Mesh(subject.sphere.normalise(subject.mesh.vertices), subject.mesh.faces, subject.mesh.smooth)
    drawn = mesh_texture(texture, subject.identity, config.seed)
    settings = ground_truth_settings(config)
    return render_textured_references(placed, subject.name, subject.identity, drawn, scenes, settings, root)


def _texture_trials(
    subject: EvaluationMesh, texture: str, config: EvaluateConfig, views: Sequence[View], truth: Sequence[Path]
) -> Iterator[Trial]:
    side = config.resolution
    for index, (view, path) in enumerate(zip(views, truth, strict=True)):
        rng = np.random.default_rng([config.seed, int(subject.identity[:16], 16), index, 1])
        kind = "gaussian" if config.noise > 0 else "none"
        cloud = sample_cloud(subject.mesh, subject.sphere, config.sampler, config.points, kind, config.noise, rng)
        picture = read_render(path, (side, side, 4))
        coverage = read_render(path.with_suffix(".coverage.png"), (side, side))
        albedo = mesh_texture(texture, subject.identity, config.seed).albedo(cloud) if texture else None
        yield Trial(subject, config, index, view, cloud, picture, coverage, texture, albedo)


def _run_weights(renderer: Renderer, trial: Trial) -> Result:
    placed = place_in_scene(trial.cloud, trial.view.scene)
    floor = with_true_floor(trial.view.scene, trial.subject.sphere.normalise(trial.subject.mesh.vertices)).floor
    factor = trial.config.supersample
    side = trial.config.resolution * factor
    colors = None if trial.albedo is None else PointColors(placed, trial.albedo)
    started = time.perf_counter()
    picture = unit_from_bytes(renderer.render(placed, trial.view.values, side, side, floor, colors))
    if factor > 1:
        picture = shrink(picture, factor)
    seconds = time.perf_counter() - started
    row = {**_metrics_row(picture, trial), "seconds": round(seconds, 4),
           "elevation": trial.view.scene.elevation, "values": trial.view.values}  # fmt: skip
    return row, picture


def _earlier_stop(rows: Sequence[Mapping[str, Any]], trial: Trial) -> Result | None:
    """The result of a baseline that was stopped before on as many points of the same mesh; None if it was not."""
    for row in rows:
        if row["mesh"] == trial.subject.name and STOPPED_AFTER in row:
            return _stopped_result(trial, row[STOPPED_AFTER])
    return None


def _stopped_result(trial: Trial, seconds: float) -> Result:
    side = trial.config.resolution
    return _row_of(trial) | {STOPPED_AFTER: seconds}, np.zeros((side, side, 4), np.float32)


def _run_baseline(
    baseline: type[Baseline], trial: Trial, truth_root: Path, log: Log, process: StoppableProcess | None
) -> Result:
    subject, config = trial.subject, trial.config
    cloud_fields = stage_fields("sample") | {
        "mesh": subject.identity, "view": trial.index, "points": config.points, "noise": config.noise,
        "sampler": plugin_fields(registry.load("samplers", config.sampler)), "seed": config.seed,
    }  # fmt: skip
    rng = np.random.default_rng([config.seed, int(subject.identity[:16], 16), trial.index, 2])
    scene = with_true_floor(trial.view.scene, subject.sphere.normalise(subject.mesh.vertices))
    settings = ground_truth_settings(config)
    result = run_baseline(
        baseline, trial.cloud, cloud_fields, rng, scene, settings, truth_root, log, trial.albedo, process
    )
    if result.stopped_after:
        return _stopped_result(trial, result.stopped_after)
    row = {**_metrics_row(result.picture, trial), "seconds": result.seconds, "render_seconds": result.render_seconds}
    return row | ({"error": result.error} if result.error else {}), result.picture


def _save_pictures(trial: Trial, results: Mapping[str, Result], folder: Path, log: Log) -> None:
    """Writes MESH_SEED_VIEW.png, and MESH_SEED_VIEW_NAME.png for each baseline; VIEW is followed by the texture."""
    for name, (row, picture) in results.items():
        parts = trial.subject.name, str(trial.config.seed), str(trial.index), trial.texture, name
        Image.fromarray(bytes_from_unit(picture)).save(folder / f"{'_'.join(filter(None, parts))}.png")
        title = " ".join(filter(None, (trial.subject.name, str(trial.index), trial.texture, name)))
        log(f"{title}: {', '.join(_metric_labels(row))}")


def _sheet_row(trial: Trial, results: Mapping[str, Result]) -> SheetRow:
    scene = trial.view.scene
    label = (f"{trial.subject.name} {trial.index} {trial.texture}".rstrip(), *_metric_labels(results[WEIGHTS_KEY][0]))
    ours, *others = (picture for _, picture in results.values())
    return make_row(label, place_in_scene(trial.cloud, scene), scene.elevation, ours, trial.truth, others)


def _metrics_row(picture: np.ndarray, trial: Trial) -> dict[str, Any]:
    metrics = image_metrics(picture, trial.truth, trial.coverage)
    return _row_of(trial) | {name: _rounded_or_none(value) for name, value in metrics.items()}


def _row_of(trial: Trial) -> dict[str, Any]:
    """What a row says about the trial itself."""
    texture = {"texture": trial.texture} if trial.texture else {}
    return {"mesh": trial.subject.name, "seed": trial.config.seed, "view": trial.index, **texture}


def ground_truth_settings(config: EvaluateConfig) -> RenderSettings:
    """Cycles settings of the ground truth."""
    side = config.resolution
    return RenderSettings((side, side), config.samples, config.denoise, config.bounces, seed=config.seed)


def _metric_labels(metrics: Mapping[str, float | None]) -> list[str]:
    formats = {"psnr_foreground": "object {:.1f} dB", "ssim": "SSIM {:.3f}", "flip": "FLIP {:.3f}"}
    if STOPPED_AFTER in metrics:
        return [f"stopped after {metrics[STOPPED_AFTER]:g} s"]
    return [form.format(metrics[name]) for name, form in formats.items() if metrics[name] is not None]


def _aggregate(rows: Sequence[Mapping[str, Any]], measure: Callable[[list[float]], Any]) -> dict[str, float]:
    names = (*METRIC_NAMES, "seconds", "render_seconds")
    values = {name: [row[name] for row in rows if row.get(name) is not None] for name in names}
    return {name: round(float(measure(column)), 6) for name, column in values.items() if column}


def _rounded_or_none(value: float) -> float | None:
    """The value rounded to 6 digits; None for nan, which JSON lacks."""
    return None if math.isnan(value) else round(value, 6)


def _write_json(path: Path, data: dict[str, Any]) -> Path:
    return atomic_write((json.dumps(data, indent=1) + "\n").encode(), path)
