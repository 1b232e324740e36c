"""Runs baselines and painters on clouds, in the ground truth's scenes.

A baseline reconstructs a mesh, which Cycles renders; a painter draws the picture itself.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.images import bytes_from_unit
from z2p_core.interfaces import ScanError
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.evaluation.time_limit import START_SECONDS, StoppableProcess, TimeLimitError
from z2p_renderer.pipeline.render import RenderError, RenderSettings, read_render, render_mesh
from z2p_renderer.pipeline.rendering.textured_meshes import render_textured_mesh
from z2p_renderer.storage.files.atomic_write import atomic_path, atomic_write
from z2p_renderer.storage.meshes import Mesh
from z2p_renderer.storage.results.code_digest import cached_part_digest
from z2p_renderer.storage.results.fingerprints import fingerprint, plugin_fields, stage_fields
from z2p_renderer.storage.results.store import Entry, Store

if TYPE_CHECKING:
    from z2p_core.interfaces import Painter

Competitor = Any
"""A class of `Baseline` or of `Painter`."""
Job = tuple[str, SceneDescription]
Log = Callable[[str], None]


@dataclass(frozen=True)
class BaselineResult:
    """A baseline's picture of a cloud.

    `picture` (H, W, 4) float32 is straight sRGB RGBA in [0, 1]; it is all 0 if the baseline failed with `error`, or was
    stopped after `stopped_after` seconds, which are 0 if it was not.
    `seconds` are those of the reconstruction, split in `steps` if the baseline reports them, and `render_seconds` those
    of Blender with its start, shared evenly among the scenes of one mesh.
    """

    picture: np.ndarray
    seconds: float | None
    render_seconds: float | None
    error: str = ""
    steps: Mapping[str, float] = field(default_factory=dict)
    stopped_after: float = 0.0


def load_baselines(names: Sequence[str]) -> dict[str, Competitor]:
    """Baseline and painter classes by name, in the order given.

    Raises:
        PluginError: one is unknown or broken.
    """
    painters = registry.names("painters")
    return {name: registry.load("painters" if name in painters else "baselines", name) for name in names}


def run_baseline(
    baseline: Competitor,
    cloud: np.ndarray,
    cloud_fields: Mapping[str, Any],
    rng: np.random.Generator,
    scene: SceneDescription,
    settings: RenderSettings,
    root: Path,
    log: Log = lambda line: None,
    albedo: np.ndarray | None = None,
    process: StoppableProcess | None = None,
) -> BaselineResult:
    """Picture of a normalised cloud in one scene; see `run_baseline_on_scenes`."""
    return run_baseline_on_scenes(baseline, cloud, cloud_fields, rng, [scene], settings, root, log, albedo, process)[0]


def run_baseline_on_scenes(
    competitor: Competitor,
    cloud: np.ndarray,
    cloud_fields: Mapping[str, Any],
    rng: np.random.Generator,
    scenes: Sequence[SceneDescription],
    settings: RenderSettings,
    root: Path,
    log: Log = lambda line: None,
    albedo: np.ndarray | None = None,
    process: StoppableProcess | None = None,
) -> list[BaselineResult]:
    """Pictures of a normalised cloud (N, 3) in scenes, whose `floor` is the true mesh's.

    They are stored under `root`, as the ground truth is, by the fingerprint of their inputs; `cloud_fields` identify
    the cloud. A cloud is reconstructed once for all missing scenes, or once per viewpoint if the baseline needs that.
    `albedo` (N, 3) are linear base colors of its points, in place of the scenes'.

    With a `process`, reconstructions and paintings run in it, and are stopped when they take longer than it allows.
    That is stored as well, and tried again with more time.

    Raises:
        PluginError: the baseline breaks its contract.
        RenderError: Blender failed, or a stored render is damaged.
    """
    folder = root / fingerprint(_fields(competitor, settings, albedo is not None))[:32]
    if albedo is not None:
        cloud_fields = {**cloud_fields, "albedo": hashlib.sha256(albedo.tobytes()).hexdigest()}
    stems = [fingerprint({"cloud": cloud_fields, "scene": scene.to_json()})[:32] for scene in scenes]
    with Store(root).lock(Entry("reference", competitor.name, {"folder": folder.name, "cloud": cloud_fields})):
        wanted = dict(zip(stems, scenes, strict=True))
        missing = [(stem, scene) for stem, scene in wanted.items() if not _is_done(folder / f"{stem}.json", process)]
        seed = int(rng.integers(2**32))  # each mesh has its own random numbers, whichever pictures are missing
        for viewer, jobs in _group_by_reconstruction(competitor, missing).items():
            folder.mkdir(parents=True, exist_ok=True)
            for stem, _ in jobs:
                (folder / f"{stem}.png").unlink(missing_ok=True)  # left by a run killed before it wrote the times
            mesh_rng = np.random.default_rng([seed, int(fingerprint({"viewer": viewer})[:16], 16)])
            record = _run_and_render(competitor, cloud, albedo, mesh_rng, jobs, folder, settings, log, process)
            for stem, _ in jobs:
                atomic_write(json.dumps(record).encode(), folder / f"{stem}.json", durable=True)
    return [_read_result(folder, stem, settings) for stem in stems]


def _fields(competitor: Competitor, settings: RenderSettings, is_colored: bool) -> dict[str, Any]:
    """Fingerprint fields of a competitor's pictures of any cloud and scene: renderer, plugin and this module."""
    stage = stage_fields("textured" if is_colored else "render")
    modules = ("pipeline.evaluation.baselines", *(["z2p_core.meshes.vertex_colors"] if is_colored else []))
    code = {**stage["code"], **{module: cached_part_digest(module) for module in modules}}
    return {**stage, "baseline": plugin_fields(competitor), "parameters": settings.shaping(), "code": code}


def with_true_floor(scene: SceneDescription, vertices: np.ndarray) -> SceneDescription:
    """The scene with its floor where Blender puts it: under the lowest of the true mesh's vertices (V, 3)."""
    lowest = float((vertices.astype(np.float64) @ np.array(scene.rotation)[2]).min())
    return replace(scene, floor=lowest)


def viewer_position(scene: SceneDescription) -> np.ndarray:
    """Position (3,) of the scene's camera in the axes of the cloud before it is rotated and lifted."""
    position = Camera(1, 1, scene.elevation).position - (0.0, 0.0, scene.lift)
    viewer: np.ndarray = np.array(scene.rotation).T @ position
    return viewer


def _group_by_reconstruction(competitor: Competitor, jobs: list[Job]) -> dict[Any, list[Job]]:
    """Jobs that share a reconstruction, by viewer position (None for all views); a painter's jobs are all separate."""
    if not hasattr(competitor, "reconstruct"):
        return {job[0]: [job] for job in jobs}
    groups: dict[Any, list[Job]] = {}
    for stem, scene in jobs:
        viewer = tuple(np.round(viewer_position(scene), 9).tolist()) if competitor.for_view else None
        groups.setdefault(viewer, []).append((stem, scene))
    return groups


def _run_and_render(
    competitor: Competitor,
    cloud: np.ndarray,
    albedo: np.ndarray | None,
    rng: np.random.Generator,
    jobs: list[Job],
    folder: Path,
    settings: RenderSettings,
    log: Log,
    process: StoppableProcess | None,
) -> dict[str, Any]:
    """Runs the competitor and renders its mesh; returns the record of times, or of the error if it failed."""
    call = _call_here if process is None else process.call
    run = _reconstruct if hasattr(competitor, "reconstruct") else _paint
    last = rng if run is _reconstruct else settings.resolution
    try:
        call(_warm_up, competitor, within=START_SECONDS)
        result, seconds, steps = call(run, competitor, cloud, albedo, jobs[0][1], last)
    except TimeLimitError as error:
        log(f"{competitor.name}: {error} on {len(cloud)} points; nothing is measured")
        stopped = 0.0 if process is None else process.seconds
        return {"seconds": None, "render_seconds": None, "error": str(error), "steps": {}, "stopped_after": stopped}
    except ScanError as error:
        log(f"{competitor.name}: {error}; an empty picture is measured")
        return {"seconds": None, "render_seconds": None, "error": str(error), "steps": {}}
    if run is _paint:
        _save(_checked_picture(competitor.name, result, settings), folder / f"{jobs[0][0]}.png")
        return _record(steps, seconds, 0.0)
    vertices, faces, colors = result
    _check(competitor.name, vertices, faces, colors)
    started = time.perf_counter()
    mesh = Mesh(vertices, faces, smooth=True)
    if colors is None:
        render_mesh(mesh, jobs, folder, settings, name=competitor.name)
    else:
        render_textured_mesh(mesh, colors, jobs, folder, settings, name=competitor.name)
    return _record(steps, seconds, (time.perf_counter() - started) / len(jobs))


def _call_here(function: Callable[..., Any], *arguments: Any, within: float | None = None) -> Any:
    """What the function returns, however long it takes."""
    return function(*arguments)


def _reconstruct(
    competitor: Competitor,
    cloud: np.ndarray,
    albedo: np.ndarray | None,
    scene: SceneDescription,
    rng: np.random.Generator,
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray | None], float, Mapping[str, float]]:
    """Vertices, triangles, and the vertices' colors if the cloud has some; seconds, and those of the steps."""
    method, viewer = competitor(), viewer_position(scene)
    started = time.perf_counter()
    mesh: tuple[np.ndarray, np.ndarray, np.ndarray | None]
    if albedo is None:
        mesh = (*method.reconstruct_for(cloud, viewer, rng), None)
    else:
        mesh = method.reconstruct_colored(cloud, albedo, viewer, rng)
    return mesh, time.perf_counter() - started, method.seconds


def _record(steps: Mapping[str, float], seconds: float, render_seconds: float) -> dict[str, Any]:
    rounded = {step: round(taken, 4) for step, taken in steps.items()}
    return {"seconds": round(seconds, 4), "render_seconds": round(render_seconds, 4), "error": "", "steps": rounded}


def _paint(
    competitor: Competitor,
    cloud: np.ndarray,
    albedo: np.ndarray | None,
    scene: SceneDescription,
    resolution: tuple[int, int],
) -> tuple[np.ndarray, float, Mapping[str, float]]:
    """A painter's picture (H, W, 4), seconds, and those of the steps."""
    painter: Painter = competitor()
    placed = cloud.astype(np.float64) @ np.array(scene.rotation).T + (0.0, 0.0, scene.lift)
    points, camera = placed.astype(np.float32), Camera(*resolution, scene.elevation)
    started = time.perf_counter()
    if albedo is None:
        picture = painter.paint(points, camera, scene)
    else:
        picture = painter.paint_colored(points, albedo, camera, scene)
    return picture, time.perf_counter() - started, painter.seconds


def _checked_picture(name: str, picture: np.ndarray, settings: RenderSettings) -> np.ndarray:
    """The picture (H, W, 4) as uint8.

    Raises:
        PluginError: the painter breaks its contract.
    """
    width, height = settings.resolution
    if picture.shape != (height, width, 4) or not (picture.min() >= 0 and picture.max() <= 1):
        raise registry.PluginError(
            f"painter {name!r}: expected ({height}, {width}, 4) in [0, 1], "
            f"got {picture.shape} from {picture.min():g} to {picture.max():g}"
        )
    return bytes_from_unit(picture)


def _save(picture: np.ndarray, path: Path) -> None:
    with atomic_path(path, durable=True) as temporary:
        Image.fromarray(picture).save(temporary, format="PNG")


def _read_result(folder: Path, stem: str, settings: RenderSettings) -> BaselineResult:
    record = _read_record(folder / f"{stem}.json")
    shape = (settings.resolution[1], settings.resolution[0], 4)
    picture = np.zeros(shape, np.float32) if record["error"] else read_render(folder / f"{stem}.png", shape)
    return BaselineResult(picture, **record)


def _is_done(path: Path, process: StoppableProcess | None) -> bool:
    """Whether the record says that the picture is made, or that its method was stopped after as long as it has now."""
    if not path.exists():
        return False
    stopped_after: float = _read_record(path)["stopped_after"]
    return not stopped_after or (process is not None and process.seconds <= stopped_after)


@cache
def _warm_up(competitor: Competitor) -> None:
    """Runs the competitor on a small cloud, so that no measured time includes the import of libraries."""
    points = np.random.default_rng(0).normal(size=(200, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    method = competitor()
    with suppress(ScanError):  # an error on a measured cloud is reported there
        if hasattr(method, "reconstruct"):
            method.reconstruct(points, np.random.default_rng(0))
        else:
            method.paint(points.astype(np.float32), Camera(32, 32), SceneDescription())


def _check(name: str, vertices: np.ndarray, faces: np.ndarray, colors: np.ndarray | None) -> None:
    sound = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3 and len(faces) > 0
    if not sound or not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise registry.PluginError(
            f"baseline {name!r}: expected finite vertices (V, 3) and triangles (M, 3) between them, "
            f"got {vertices.shape} and {faces.shape}"
        )
    if colors is not None and not (colors.shape == vertices.shape and colors.min() >= 0 and colors.max() <= 1):
        raise registry.PluginError(f"baseline {name!r}: expected colors {vertices.shape} in [0, 1] of its vertices, "
                                   f"got {colors.shape} from {colors.min():g} to {colors.max():g}")  # fmt: skip


def _read_record(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        required = {name: record[name] for name in ("seconds", "render_seconds", "error")}
        return required | {"steps": record.get("steps", {}), "stopped_after": float(record.get("stopped_after", 0.0))}
    except (ValueError, KeyError, TypeError) as error:
        raise RenderError(f"{path}: not a readable record ({error}); delete it to render again") from error
