"""How good weights are: their pictures of sampled clouds against Blender's renders of the meshes."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipeline.infer import Renderer
from pipeline.render import RenderError, RenderSettings, render_scenes
from pipeline.sample import draw_cloud
from pipeline.sheets import SheetRow, sheet_row, write_sheets
from pipeline.views import View, describe, draw_view, view_rng
from storage.checkpoints import resolve
from storage.clouds import read_mesh
from storage.fingerprints import file_digest, fingerprint, stage_fields
from z2p_core import registry
from z2p_core.config import EvaluateConfig, to_dict
from z2p_core.geometry import bounding_sphere
from z2p_core.images import unit_from_bytes
from z2p_core.interfaces import ScanError, SettingError
from z2p_core.metrics import NAMES, picture_metrics
from z2p_core.scene import SceneDescription

UPRIGHT = 0.5
"""Share of the views that turn the mesh about +Z only, as in training."""

Log = Callable[[str], None]


@dataclass(frozen=True)
class Subject:
    """A mesh to evaluate on; `identity` is the sha256 of its file."""

    name: str
    path: Path
    identity: str


def evaluate(
    meshes: Mapping[str, Path],
    weights: str | Path,
    out: Path,
    config: EvaluateConfig,
    truth_root: Path,
    log: Log = lambda line: None,
) -> Path:
    """``out/metrics.json``: a row a mesh and view, means and spread; beside it the pictures and contact sheets.

    Views and clouds follow from the seed, the mesh's bytes and the view's number, not from names or other meshes.
    Ground truth is kept under `truth_root` by what shapes it, so that the next weights find it there.

    Raises:
        ScanError: no meshes, or one that cannot be read.
        WeightsError, PluginError: the weights, or a plugin that they or the config need, cannot be used.
        SettingError: an elevation that the weights do not know.
        RenderError: Blender failed, or a kept render is damaged.
    """
    if not meshes:
        raise ScanError("expected meshes to evaluate on, got none; give a folder with at least one")
    registry.load("samplers", config.sampler)  # an unknown one shows before the first render
    renderer = Renderer(weights)
    subjects = [Subject(name, path, file_digest(path)) for name, path in meshes.items()]
    (out / "pictures").mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    sheet: list[SheetRow] = []
    for subject in subjects:
        views = draw_views(renderer, subject.identity, config)
        truth = render_truth(subject, [view.scene for view in views], config, truth_root, log)
        for row, sheet_line in _measure(subject, views, truth, renderer, out / "pictures", config):
            rows.append(row)
            sheet.append(sheet_line)
            log(f"{row['mesh']} {row['view']}: " + ", ".join(sheet_line.label[1:]))
    write_sheets(sheet, out)
    settings = {
        "config": to_dict(config),
        "weights": {"name": Path(weights).name, "sha256": file_digest(resolve(weights))},
        "meshes": {subject.name: subject.identity for subject in subjects},
    }
    return _write_json(out / "metrics.json", {"settings": settings, **summarise(rows), "rows": rows})


def draw_views(renderer: Renderer, identity: str, config: EvaluateConfig) -> list[View]:
    """The views of a mesh with that content digest, at the config's elevation or, where it has none, at any.

    Raises:
        SettingError: an elevation that the weights do not know.
    """
    controls, elevation = renderer.controls, config.elevation
    if "elevation" not in controls:
        fixed = renderer.fixed_elevation
        if elevation is not None and fixed is not None and not math.isclose(elevation, fixed):
            raise SettingError(f"elevation: these weights know only {fixed:g} degrees, got {elevation:g}")
        elevation = fixed
    views = []
    for index in range(config.views):
        view = draw_view(controls, view_rng(config.seed, identity, index), UPRIGHT)
        values, scene = dict(view.values), view.scene
        if elevation is not None:
            if "elevation" in controls:
                values["elevation"] = controls["elevation"].check((elevation,))
            scene = describe(controls, values, np.array(scene.rotation))
            scene.elevation = elevation
        views.append(View(scene, values))
    return views


def render_truth(
    subject: Subject, scenes: Sequence[SceneDescription], config: EvaluateConfig, truth_root: Path, log: Log
) -> list[Path]:
    """Picture of each scene (its coverage beside it), rendered only where `truth_root` does not hold it yet.

    The folder's name is the fingerprint of mesh and render settings, the file's that of the scene: asking for more
    views, or for other weights with the same controls, keeps what is there.
    """
    side = config.resolution
    settings = RenderSettings((side, side), config.samples, config.denoise, seed=config.seed)
    parameters = {name: value for name, value in asdict(settings).items() if name != "threads"}
    fields = stage_fields("render") | {"mesh": subject.identity, "parameters": parameters}
    folder = truth_root / fingerprint(fields)[:32]
    stems = [fingerprint(scene.to_json())[:16] for scene in scenes]
    render_scenes(subject.path, list(dict(zip(stems, scenes, strict=True)).items()), folder, settings, log)
    return [folder / f"{stem}.png" for stem in stems]


def summarise(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means, spread (standard deviation over the rows) and means by mesh; rows without a figure are left out of it."""
    by_mesh: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        by_mesh.setdefault(row["mesh"], []).append(row)
    return {
        "means": _over(rows, np.mean),
        "spread": _over(rows, np.std),
        "meshes": {mesh: _over(own, np.mean) for mesh, own in by_mesh.items()},
    }


def _measure(
    subject: Subject,
    views: Sequence[View],
    truth: Sequence[Path],
    renderer: Renderer,
    pictures: Path,
    config: EvaluateConfig,
) -> list[tuple[dict[str, Any], SheetRow]]:
    """Row of figures and row of the sheet for each view of a mesh; writes the predictions."""
    mesh = read_mesh(subject.path)
    sphere = bounding_sphere(mesh.vertices)
    measured = []
    for index, (view, path) in enumerate(zip(views, truth, strict=True)):
        rng = np.random.default_rng([config.seed, int(subject.identity[:16], 16), index, 1])
        kind = "gaussian" if config.noise > 0 else "none"
        drawn = draw_cloud(mesh, sphere, config.sampler, config.points, kind, config.noise, rng)
        cloud = place(drawn, view.scene)
        started = time.perf_counter()
        prediction = renderer.render(cloud, view.values, config.resolution, config.resolution)
        seconds = time.perf_counter() - started
        Image.fromarray(prediction).save(pictures / f"{subject.name}_{index}.png")
        ours, theirs = unit_from_bytes(prediction), _read_picture(path, (config.resolution, config.resolution, 4))
        coverage = _read_picture(path.with_suffix(".coverage.png"), theirs.shape[:2])
        figures = {name: _number(value) for name, value in picture_metrics(ours, theirs, coverage).items()}
        row = {"mesh": subject.name, "view": index, **figures, "seconds": round(seconds, 4),
               "elevation": view.scene.elevation, "values": view.values}  # fmt: skip
        label = (f"{subject.name} {index}", *_label(figures))
        measured.append((row, sheet_row(label, cloud, view.scene.elevation, ours, theirs)))
    return measured


def place(cloud: np.ndarray, scene: SceneDescription) -> np.ndarray:
    """Normalised cloud (N, 3) turned and lifted as the scene's mesh is, (N, 3) float32."""
    turned = cloud.astype(np.float64) @ np.array(scene.rotation).T
    turned[:, 2] += scene.lift
    return turned.astype(np.float32)


def _read_picture(path: Path, shape: tuple[int, ...]) -> np.ndarray:
    """Float32 in [0, 1] of a kept render.

    Raises:
        RenderError: it is missing, damaged, or of another shape.
    """
    try:
        with Image.open(path) as image:
            picture = np.asarray(image)
    except (OSError, SyntaxError) as error:  # pillow raises SyntaxError on a broken chunk
        raise RenderError(f"{path}: not a readable picture ({error}); delete {path.parent} to render again") from error
    if picture.shape != shape or picture.dtype != np.uint8:
        raise RenderError(f"{path}: expected {shape} uint8, got {picture.shape} {picture.dtype}; "
                          f"delete {path.parent} to render again")
    return unit_from_bytes(picture)


def _label(figures: Mapping[str, float | None]) -> list[str]:
    shown = {"psnr_foreground": "object {:.1f} dB", "ssim": "SSIM {:.3f}", "flip": "FLIP {:.3f}"}
    return [form.format(figures[name]) for name, form in shown.items() if figures[name] is not None]


def _over(rows: Sequence[Mapping[str, Any]], measure: Callable[[list[float]], Any]) -> dict[str, float]:
    found = {name: [row[name] for row in rows if row[name] is not None] for name in (*NAMES, "seconds")}
    return {name: round(float(measure(values)), 6) for name, values in found.items() if values}


def _number(value: float) -> float | None:
    """JSON has no nan."""
    return None if math.isnan(value) else round(value, 6)


def _write_json(path: Path, data: dict[str, Any]) -> Path:
    temporary = path.with_name(f".{path.name}")
    temporary.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    temporary.replace(path)
    return path
