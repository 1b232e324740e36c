"""Ground truth: Blender's renders of a mesh's scenes, stored one result per scene and shared by all evaluations."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.render import RenderSettings, render_scenes
from z2p_renderer.storage.results.fingerprints import fingerprint, stage_fields
from z2p_renderer.storage.results.store import Entry, Store

PICTURE_FILE = "picture.png"
COVERAGE_FILE = "picture.coverage.png"


def render_references(
    mesh_path: Path,
    identity: str,
    scenes: Sequence[SceneDescription],
    settings: RenderSettings,
    root: Path,
    log: Callable[[str], None] = lambda line: None,
) -> list[Path]:
    """Path of each scene's picture (its coverage beside it); renders those that the store at `root` lacks.

    `identity` is the sha256 of the mesh's file. One Blender process renders all missing pictures one by one; after a
    kill, finished ones are kept.

    Raises:
        ScanError: the mesh cannot be read.
        RenderError: Blender failed or left out a picture.
    """
    store = Store(root)
    entries = [reference_entry(mesh_path.stem, identity, scene, settings) for scene in scenes]
    shared = Entry("reference", mesh_path.stem, _shared(identity, settings))
    with store.lock(shared):
        for entry in entries:
            store.quarantine_if_damaged(entry)
        pairs = list(zip(entries, scenes, strict=True))
        missing = {scene_stem(scene): scene for entry, scene in pairs if not store.complete(entry)}
        work = store.work_folder(shared)
        if missing:
            render_scenes(mesh_path, list(missing.items()), work, settings, log)
        for entry, scene in pairs:
            store.produce(entry, partial(_move_files, work, scene_stem(scene)))
        shutil.rmtree(work, ignore_errors=True)  # also leftovers of a killed run
    return [store.folder(entry) / PICTURE_FILE for entry in entries]


def reference_entry(name: str, identity: str, scene: SceneDescription, settings: RenderSettings) -> Entry:
    """Store entry of one scene's render."""
    fields = _shared(identity, settings) | {"scene": scene.to_json()}
    return Entry("reference", f"reference/{name}/{scene_stem(scene)}", fields)


def legacy_picture_path(root: Path, identity: str, scene: SceneDescription, settings: RenderSettings) -> Path:
    """Path of the picture if an old z2p rendered it, before such pictures had manifests."""
    fields = {"schema": 1, "stage": "render", "stage_version": 1}
    fields |= {"mesh": identity, "parameters": settings.shaping()}
    return root / fingerprint(fields)[:32] / f"{scene_stem(scene)}.png"


def scene_stem(scene: SceneDescription) -> str:
    """Name of a scene's picture while Blender renders it; the seed of its noise derives from it."""
    return fingerprint(scene.to_json())[:16]


def _shared(identity: str, settings: RenderSettings) -> dict[str, Any]:
    return stage_fields("reference") | {"mesh": identity, "parameters": settings.shaping()}


def _move_files(work: Path, name: str, folder: Path) -> None:
    # the picture first: after a kill, a view without it is rendered again
    (work / f"{name}.png").rename(folder / PICTURE_FILE)
    (work / f"{name}.coverage.png").rename(folder / COVERAGE_FILE)
