"""Cycles renders of meshes with colors of their own, as `pipeline.render` makes those in one color.

It runs another child process, by code of its own: a change of `pipeline.render`'s would make all renders stale that are
on disk.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from z2p_renderer.pipeline import render
from z2p_renderer.pipeline.child_process import child_environment
from z2p_renderer.pipeline.render import RenderSettings, Scenes
from z2p_renderer.pipeline.rendering.textures import SeededTexture
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.meshes import Mesh

TEXTURE_EDGE = 0.01
"""Longest edge of the triangles at whose corners a texture is evaluated, world units: a pixel of a picture of 256."""
LAST_LINES = 12
"""Lines of Blender's that an error message ends with."""


def render_textured_mesh(
    mesh: Mesh,
    colors: SeededTexture | np.ndarray,
    scenes: Scenes,
    out: Path,
    settings: RenderSettings,
    name: str = "mesh",
) -> None:
    """Render each (stem, scene) of a mesh in world units into `out`; pictures that are there already are left alone.

    It writes what `pipeline.render.render_mesh` writes. `colors` take the place of the scenes' base color: a texture,
    evaluated on a finer mesh of the same surface and shading normals, or linear colors (V, 3) of the vertices.

    Raises:
        RenderError: Blender failed or left out a picture.
        DiskError: the disk is full, here or in Blender.
    """
    out.mkdir(parents=True, exist_ok=True)
    missing = [(stem, scene.to_json()) for stem, scene in scenes if not (out / f"{stem}.png").exists()]
    if not missing:
        return
    job = {"settings": asdict(settings), "scenes": missing, "max_edge": TEXTURE_EDGE}
    arrays: dict[str, Any] = {"vertices": mesh.vertices.astype(np.float32), "faces": mesh.faces, "smooth": mesh.smooth}
    if isinstance(colors, SeededTexture):
        job["texture"] = colors.to_json()
    else:
        arrays["albedo"] = np.asarray(colors, np.float32)
    with tempfile.TemporaryDirectory(prefix=".blender-", dir=out) as temporary:
        folder = Path(temporary)
        atomic_write(render._npz_bytes(**arrays), folder / "mesh.npz")
        (folder / "job.json").write_text(json.dumps(job))
        for stem in _run_blender(folder, name):
            try:
                render._write_outputs(folder / f"{stem}.exr", out, stem)
            except (RuntimeError, LookupError, ValueError) as error:  # what OpenEXR raises on an incomplete file
                message = f"{name}: Blender left no complete picture of {stem} ({error})"
                raise render._failure(folder, message) from error
    left = [stem for stem, _ in missing if not (out / f"{stem}.png").exists()]
    if left:
        raise render._failure(out, f"{name}: Blender ended without rendering {left[0]} and {len(left) - 1} more")


def _run_blender(job: Path, name: str) -> Iterator[str]:
    """Yield the stem of each picture as soon as it is whole."""
    command = [sys.executable, "-m", "z2p_renderer.pipeline.textured_blender", str(job)]
    last: deque[str] = deque(maxlen=LAST_LINES)
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=child_environment()
    ) as blender:
        try:
            for line in blender.stdout or ():
                last.append(line.rstrip())
                if line.startswith("done "):
                    yield line.split()[1]
        except BaseException:
            blender.kill()
            raise
    if blender.returncode:
        message = f"{name}: Blender exited with {blender.returncode}\nits last lines:\n" + "\n".join(last)
        raise render._failure(job, message)
