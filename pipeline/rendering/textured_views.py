"""Random views for training in which some meshes have colors of their own, as a texture gives them.

A view's scene is that of `pipeline.rendering.views`: its texture is drawn after everything else. It is a module of its
own so that renders in one color do not depend on its code.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from z2p_core.config import RenderConfig
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_renderer.pipeline.render import render_mesh
from z2p_renderer.pipeline.rendering.textured_meshes import render_textured_mesh
from z2p_renderer.pipeline.rendering.textures import SeededTexture
from z2p_renderer.pipeline.rendering.views import load_controls, sample_view, training_render_settings, view_rng
from z2p_renderer.storage.meshes import Mesh, read_mesh

SEED_LIMIT = 2**32
"""Seeds of textures are below it."""


def draw_texture(config: RenderConfig, rng: np.random.Generator) -> SeededTexture | None:
    """A random one of the config's textures, or None for a view in one color."""
    if rng.uniform() >= config.textured_share:
        return None
    return SeededTexture(config.textures[rng.integers(len(config.textures))], (int(rng.integers(SEED_LIMIT)),))


def render_textured_chunk(
    mesh_path: Path,
    identity: str,
    first: int,
    last: int,
    config: RenderConfig,
    out: Path,
    log: Callable[[str], None] = print,
) -> None:
    """Renders views `first` to `last` - 1 of a mesh into `out`, each with ``view_NNNNN.json``: scene, values, texture.

    Arguments and files are those of `pipeline.rendering.views.render_chunk`. The texture is null, or has its name and
    seed; it gives the colors of places in the unit sphere, before the scene rotates them.

    Raises:
        ScanError: the mesh cannot be read.
        RenderError: Blender failed or left out a picture.
        PluginError: a texture is unknown or broken.
    """
    out.mkdir(parents=True, exist_ok=True)
    controls, settings = load_controls(config.controls), training_render_settings(config)
    mesh = read_mesh(mesh_path)
    placed = Mesh(bounding_sphere(mesh.vertices).normalise(mesh.vertices), mesh.faces, mesh.smooth)
    plain = []
    for index in range(first, last):
        rng, stem = view_rng(config.seed, identity, index), f"view_{index:05d}"
        view, texture = sample_view(controls, rng, config.upright), draw_texture(config, rng)
        content = {"scene": view.scene.to_json(), "values": view.values, "texture": texture and texture.to_json()}
        (out / f"{stem}.json").write_text(json.dumps(content))
        if texture is None:
            plain.append((stem, view.scene))
        else:
            render_textured_mesh(placed, texture, [(stem, view.scene)], out, settings, mesh_path.name)
            log(f"{mesh_path.stem}: {stem} rendered with {texture.name}")
    render_mesh(placed, plain, out, settings, log, mesh_path.name)
