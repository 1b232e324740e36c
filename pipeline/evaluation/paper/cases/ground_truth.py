"""Ground truth of the report's cases, in the store of `z2p evaluate` and shared with it where the scenes match."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.config.report import ReportConfig
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import Case
from z2p_renderer.pipeline.render import RenderSettings, read_render, render_mesh
from z2p_renderer.pipeline.rendering.ground_truth import COVERAGE_FILE, PICTURE_FILE, render_references
from z2p_renderer.pipeline.rendering.textured_truth import render_textured_references
from z2p_renderer.pipeline.rendering.textures import SeededTexture
from z2p_renderer.storage.meshes import Mesh
from z2p_renderer.storage.results.fingerprints import stage_fields
from z2p_renderer.storage.results.store import Entry, Store

Log = Callable[[str], None]


def report_render_settings(config: ReportConfig) -> RenderSettings:
    """Cycles settings of the ground truth and of the baselines' meshes alike."""
    return RenderSettings((config.resolution, config.resolution), config.samples, config.denoise, seed=config.seed)


def render_case_truths(
    cases: Sequence[Case], config: ReportConfig, root: Path, log: Log = lambda line: None
) -> list[tuple[np.ndarray, np.ndarray]]:
    """True picture (H, W, 4) and coverage (H, W) of each case, float32 in [0, 1]; renders those that `root` lacks.

    Raises:
        RenderError: Blender failed, or a stored render is damaged.
    """
    settings, side = report_render_settings(config), config.resolution
    paths: list[Path] = [Path()] * len(cases)
    shared: dict[tuple[str, SeededTexture | None], list[int]] = {}
    for index, case in enumerate(cases):
        if case.subject is None:
            paths[index] = _render_synthetic(case.truth, case.scene, settings, root, log)
        else:
            shared.setdefault((case.subject.identity, case.texture), []).append(index)
    for (_, texture), indices in shared.items():  # all scenes of a mesh in one Blender process
        subject = cases[indices[0]].subject
        if subject is None or subject.path is None:
            raise ValueError("a case with a subject needs the path of its mesh file, got none")
        scenes = [cases[index].scene for index in indices]
        if texture is None:
            rendered = render_references(subject.path, subject.identity, scenes, settings, root, log)
        else:
            rendered = render_textured_references(
                subject.mesh, subject.name, subject.identity, texture, scenes, settings, root
            )
        for index, path in zip(indices, rendered, strict=True):
            paths[index] = path
    return [(read_render(path, (side, side, 4)), read_render(path.with_suffix(".coverage.png"), (side, side)))
            for path in paths]  # fmt: skip


def mesh_digest(mesh: Mesh) -> str:
    """sha256 (64 hex digits) of a mesh in memory."""
    parts = (np.ascontiguousarray(mesh.vertices, np.float64), np.ascontiguousarray(mesh.faces, np.int64))
    return hashlib.sha256(b"".join(part.tobytes() for part in parts) + bytes([mesh.smooth])).hexdigest()


def _render_synthetic(mesh: Mesh, scene: SceneDescription, settings: RenderSettings, root: Path, log: Log) -> Path:
    """Path of the picture of a synthetic mesh, which is not scaled to the unit sphere."""
    fields: dict[str, Any] = stage_fields("reference") | {
        "placed": mesh_digest(mesh), "parameters": settings.shaping(), "scene": scene.to_json(),
    }  # fmt: skip
    store = Store(root)
    entry = Entry("reference", "reference/made", fields)
    store.quarantine_if_damaged(entry)
    return store.produce(entry, partial(_render_into, mesh, scene, settings, log)) / PICTURE_FILE


def _render_into(mesh: Mesh, scene: SceneDescription, settings: RenderSettings, log: Log, folder: Path) -> None:
    stem = PICTURE_FILE.removesuffix(".png")
    render_mesh(mesh, [(stem, scene)], folder, settings, log, "made shape")
    if not (folder / COVERAGE_FILE).is_file():
        raise FileNotFoundError(f"{folder / COVERAGE_FILE}: the render left no coverage")
