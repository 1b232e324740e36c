"""Random views of a mesh for training and evaluation: a rotation, and a value for each control."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from z2p_core import registry
from z2p_core.camera import turn
from z2p_core.config import RenderConfig
from z2p_core.interfaces import Control, Value
from z2p_core.rotations import random_rotation
from z2p_core.scene import SceneDescription
from z2p_core.settings import apply_controls
from z2p_renderer.pipeline.render import RenderSettings, render_scenes


@dataclass(frozen=True)
class View:
    """One random view: the scene that Blender renders, and the value of each control."""

    scene: SceneDescription
    values: dict[str, Value]


def load_controls(names: tuple[str, ...]) -> dict[str, Control]:
    """Controls by name, in the order of the settings vector."""
    return {name: registry.load("controls", name)() for name in names}


def sample_view(controls: dict[str, Control], rng: np.random.Generator, upright: float) -> View:
    """Random view; with probability `upright` the mesh is rotated about +Z only, else by any rotation."""
    rotation = turn(rng.uniform(0, 360)) if rng.uniform() < upright else random_rotation(rng)
    values = {name: control.draw(rng) for name, control in controls.items()}
    return View(describe(controls, values, rotation), values)


def describe(controls: dict[str, Control], values: dict[str, Value], rotation: np.ndarray) -> SceneDescription:
    """Scene in which each control is applied at its value."""
    scene = SceneDescription(rotation=tuple(tuple(row) for row in rotation.tolist()))
    apply_controls(values, controls, scene)
    return scene


def place_in_scene(cloud: np.ndarray, scene: SceneDescription) -> np.ndarray:
    """Cloud (N, 3) in the unit sphere, rotated and lifted as the scene's mesh is: (N, 3) float32."""
    turned = cloud.astype(np.float64) @ np.array(scene.rotation).T
    turned[:, 2] += scene.lift
    return turned.astype(np.float32)


def view_rng(seed: int, identity: str, index: int) -> np.random.Generator:
    """Random generator of view `index` of the mesh with content digest `identity` (hex), whatever the mesh's name."""
    return np.random.default_rng([seed, int(identity[:16], 16), index])


def render_chunk(
    mesh_path: Path,
    identity: str,
    first: int,
    last: int,
    config: RenderConfig,
    out: Path,
    log: Callable[[str], None] = print,
) -> None:
    """Renders views `first` to `last` - 1 of a mesh into `out`, each with ``view_NNNNN.json`` (scene and values).

    `identity` is the mesh's content digest in hex. Views that `out` holds already are kept.
    """
    out.mkdir(parents=True, exist_ok=True)
    controls = load_controls(config.controls)
    scenes = []
    for index in range(first, last):
        view = sample_view(controls, view_rng(config.seed, identity, index), config.upright)
        stem = f"view_{index:05d}"
        (out / f"{stem}.json").write_text(json.dumps({"scene": view.scene.to_json(), "values": view.values}))
        scenes.append((stem, view.scene))
    render_scenes(mesh_path, scenes, out, training_render_settings(config), log)


def training_render_settings(config: RenderConfig) -> RenderSettings:
    """The Cycles settings of the render stage's config."""
    side = config.resolution
    return RenderSettings((side, side), config.samples, config.denoise, config.bounces, config.passes, config.seed)
