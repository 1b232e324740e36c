"""Distillation: trained weights draw a cloud at a higher resolution, and others learn the downsampled image."""

from __future__ import annotations

from typing import Any

import numpy as np

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.images import premultiplied_from_straight, shrink, unit_from_bytes
from z2p_core.interfaces import Engine
from z2p_core.native import to_straight_rgba8
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.inference.engine_selection import start_engine
from z2p_renderer.pipeline.inference.input_buffers import draw_buffers
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.storage.models.checkpoints import find_weights

FAST_ENGINE = "openvino-bf16"
"""Twice as fast as an exact engine; its rounding is far smaller than a teacher's own error."""


def teacher_engine() -> str | None:
    """Name of the engine that teachers run on; None for the default exact one."""
    fast: type[Engine] = registry.load("engines", FAST_ENGINE)
    return FAST_ENGINE if fast.installed() else None


class TeacherError(ValueError):
    """Weights that cannot teach on these shards; the message says which and why."""


class Teacher:
    """Trained weights that draw a training cloud at a higher resolution and downsample the image. Thread-safe.

    A downsampled image is closer to the render than one drawn at the target resolution. Unlike the render it shows
    nothing that the cloud does not contain, so a network can learn it (Hinton et al., Distilling the knowledge in a
    neural network, 2015).
    """

    def __init__(self, weights: str, resolution: int, controls: list[dict[str, Any]]) -> None:
        """Teacher of a shipped name or a file; draws at `resolution` with the shards' `controls`.

        Raises:
            WeightsError: no such weights, a file that holds none, or no installed engine can run them.
            PluginError: they need a plugin that is not installed.
            TeacherError: they have other controls.
        """
        file = find_weights(weights)
        self._loaded, self.resolution = load_plugins(file), resolution
        expected = [[control["name"], control["version"]] for control in controls]
        known = [[control["name"], control["version"]] for control in self._loaded.card["controls"]]
        if known != expected:
            raise TeacherError(
                f"train.teacher: expected weights whose controls are {expected}, got {known} in {weights}"
            )
        self._engine = start_engine(self._loaded, file, teacher_engine(), threads=1, exact=True)
        cells = Camera(resolution, resolution).frame_coordinates(step=self._loaded.config.unshuffle)
        self._encoding = self._loaded.encoder.encode(*cells)

    def picture(self, cloud: np.ndarray, scene: SceneDescription, settings: np.ndarray, side: int) -> np.ndarray:
        """Premultiplied RGBA (side, side, 4) float32 in [0, 1] of a placed cloud (N, 3) with settings (S,)."""
        camera = Camera(self.resolution, self.resolution, scene.elevation)
        buffers = draw_buffers(cloud, camera, scene, self._loaded.zbuffer, self._loaded.gbuffer)
        drawn = to_straight_rgba8(self._engine.draw(buffers[None], self._encoding, settings[None])[0])
        return premultiplied_from_straight(shrink(unit_from_bytes(drawn), self.resolution // side))
