"""Ground truth of meshes with textures, stored as `pipeline.rendering.ground_truth` stores that in one color."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.render import RenderSettings
from z2p_renderer.pipeline.rendering.ground_truth import COVERAGE_FILE, PICTURE_FILE, scene_stem
from z2p_renderer.pipeline.rendering.textured_meshes import render_textured_mesh
from z2p_renderer.pipeline.rendering.textures import SeededTexture
from z2p_renderer.storage.meshes import Mesh
from z2p_renderer.storage.results.fingerprints import stage_fields
from z2p_renderer.storage.results.store import Entry, Store


def render_textured_references(
    mesh: Mesh,
    name: str,
    identity: str,
    texture: SeededTexture,
    scenes: Sequence[SceneDescription],
    settings: RenderSettings,
    root: Path,
) -> list[Path]:
    """Path of each scene's picture (its coverage beside it); renders those that the store at `root` lacks.

    `mesh` lies in the unit sphere, and `identity` is the sha256 of its file. One Blender process renders all missing
    pictures one by one; after a kill, finished ones are kept.

    Raises:
        RenderError: Blender failed or left out a picture.
        PluginError: the texture is unknown or broken.
    """
    store = Store(root)
    shared: dict[str, Any] = stage_fields("textured") | {
        "mesh": identity, "parameters": settings.shaping(), "texture": texture.fields(),
    }  # fmt: skip
    stems = {scene_stem(scene): scene for scene in scenes}
    label = f"textured/{name}/{texture.name}"
    entries = {
        stem: Entry("textured", f"{label}/{stem}", shared | {"scene": scene.to_json()})
        for stem, scene in stems.items()
    }
    whole = Entry("textured", label, shared)
    with store.lock(whole):
        for entry in entries.values():
            store.quarantine_if_damaged(entry)
        missing = [(stem, stems[stem]) for stem, entry in entries.items() if not store.complete(entry)]
        work = store.work_folder(whole)
        if missing:
            render_textured_mesh(mesh, texture, missing, work, settings, f"{name} with {texture.name}")
        for stem, entry in entries.items():
            store.produce(entry, partial(_move_files, work, stem))
        shutil.rmtree(work, ignore_errors=True)  # also leftovers of a killed run
    return [store.folder(entries[scene_stem(scene)]) / PICTURE_FILE for scene in scenes]


def _move_files(work: Path, stem: str, folder: Path) -> None:
    # the picture first: after a kill, a view without it is rendered again
    (work / f"{stem}.png").rename(folder / PICTURE_FILE)
    (work / f"{stem}.coverage.png").rename(folder / COVERAGE_FILE)
