"""What baselines make of the same clouds: meshes, rendered by Cycles in the ground truth's place, light and floor."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.render import RenderError, RenderSettings, read_render, render_mesh
from storage.fingerprints import fingerprint, plugin_fields, stage_fields
from storage.meshes import Mesh
from z2p_core import registry
from z2p_core.interfaces import ScanError
from z2p_core.scene import SceneDescription

if TYPE_CHECKING:
    from z2p_core.interfaces import Baseline


@dataclass(frozen=True)
class Rebuilt:
    """A baseline's picture of a cloud.

    `picture` (H, W, 4) float32 is straight sRGB RGBA in [0, 1], all 0 where there is an `error`: what the baseline said
    of a cloud that it could not use. The seconds are those of the reconstruction and of Blender, its start included.
    """

    picture: np.ndarray
    seconds: float | None
    render_seconds: float | None
    error: str = ""


def load_baselines(names: Sequence[str]) -> dict[str, type[Baseline]]:
    """Baseline classes by name, in the order given.

    Raises:
        PluginError: one is unknown or broken.
    """
    return {name: registry.load("baselines", name) for name in names}


def rebuild(
    baseline: type[Baseline],
    cloud: np.ndarray,
    cloud_fields: Mapping[str, Any],
    rng: np.random.Generator,
    scene: SceneDescription,
    settings: RenderSettings,
    root: Path,
    log: Callable[[str], None] = lambda line: None,
) -> Rebuilt:
    """Picture of a normalised cloud (N, 3) in a scene, whose `floor` is the true mesh's.

    Kept under `root`, as the ground truth is, by all that shapes it; `cloud_fields` are what shapes the cloud.

    Raises:
        PluginError: the baseline breaks its contract.
        RenderError: Blender failed, or a kept render is damaged.
    """
    parameters = {name: value for name, value in asdict(settings).items() if name != "threads"}
    fields = stage_fields("render") | {"baseline": plugin_fields(baseline), "parameters": parameters}
    folder = root / fingerprint(fields)[:32]
    stem = fingerprint({"cloud": cloud_fields, "scene": scene.to_json()})[:32]
    record = folder / f"{stem}.json"
    if not record.exists():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{stem}.png").unlink(missing_ok=True)  # cut off before its times were written
        told = _reconstruct_and_render(baseline, cloud, rng, (stem, scene), folder, settings, log)
        temporary = folder / f".{stem}.json"
        temporary.write_text(json.dumps(told), encoding="utf-8")
        temporary.replace(record)
    told = _read_record(record)
    shape = (settings.resolution[1], settings.resolution[0], 4)
    picture = np.zeros(shape, np.float32) if told["error"] else read_render(folder / f"{stem}.png", shape)
    return Rebuilt(picture, told["seconds"], told["render_seconds"], told["error"])


def on_true_floor(scene: SceneDescription, vertices: np.ndarray) -> SceneDescription:
    """The scene with its floor where Blender puts it under the true mesh of normalised vertices (V, 3)."""
    lowest = float((vertices.astype(np.float64) @ np.array(scene.rotation)[2]).min())
    return replace(scene, floor=lowest)


def _reconstruct_and_render(
    baseline: type[Baseline],
    cloud: np.ndarray,
    rng: np.random.Generator,
    job: tuple[str, SceneDescription],
    folder: Path,
    settings: RenderSettings,
    log: Callable[[str], None],
) -> dict[str, Any]:
    """What is kept beside the picture: times, and the error of a baseline that made none."""
    _warm_up(baseline)
    started = time.perf_counter()
    try:
        vertices, faces = baseline().reconstruct(cloud, rng)
    except ScanError as error:
        log(f"{baseline.name}: {error}; an empty picture counts")
        return {"seconds": None, "render_seconds": None, "error": str(error)}
    seconds = time.perf_counter() - started
    _check(baseline.name, vertices, faces)
    started = time.perf_counter()
    render_mesh(Mesh(vertices, faces, smooth=True), [job], folder, settings, name=baseline.name)
    rendered = time.perf_counter() - started
    return {"seconds": round(seconds, 4), "render_seconds": round(rendered, 4), "error": ""}


@cache
def _warm_up(baseline: type[Baseline]) -> None:
    """Nothing: a small cloud goes through first, so that no cloud's time holds the import of libraries."""
    points = np.random.default_rng(0).normal(size=(200, 3))
    with suppress(ScanError):  # told when a cloud that counts is refused
        baseline().reconstruct(points / np.linalg.norm(points, axis=1, keepdims=True), np.random.default_rng(0))


def _check(name: str, vertices: np.ndarray, faces: np.ndarray) -> None:
    sound = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3 and len(faces) > 0
    if not sound or not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise registry.PluginError(
            f"baseline {name!r}: expected finite vertices (V, 3) and triangles (M, 3) between them, "
            f"got {vertices.shape} and {faces.shape}"
        )


def _read_record(path: Path) -> dict[str, Any]:
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        return {name: told[name] for name in ("seconds", "render_seconds", "error")}
    except (ValueError, KeyError, TypeError) as error:
        raise RenderError(f"{path}: not a readable record ({error}); delete it to render again") from error
