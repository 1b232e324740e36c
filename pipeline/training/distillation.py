"""Distillation: finished weights show what a cloud tells at twice the size and more, for others to reach at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.images import premultiplied_from_straight, shrink, unit_from_bytes
from z2p_core.interfaces import Engine
from z2p_core.native import straight_bytes
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.inference.engine_selection import start_engine
from z2p_renderer.pipeline.inference.input_buffers import draw_buffers
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.storage.models.checkpoints import find_weights

FAST_ENGINE = "openvino-bf16"
"""Twice as quick as an exact one, and what it rounds is far less than what a teacher errs."""


def teacher_engine() -> str | None:
    """Name of the engine that teachers run on; None for whichever exact one there is."""
    quick: type[Engine] = registry.load("engines", FAST_ENGINE)
    return FAST_ENGINE if quick.installed() else None


class TeacherError(ValueError):
    """Weights that cannot teach these shards; the message says which and why."""


class Teacher:
    """Weights that draw a training cloud larger than it is learnt from, and shrink the picture. Threads may share one.

    What weights draw larger and shrink is nearer to the render than what they draw at once. Unlike the render it shows
    nothing that the cloud does not tell, so it can be learnt (Hinton et al., Distilling the knowledge in a neural
    network, 2015).
    """

    def __init__(self, weights: str, resolution: int, controls: list[dict[str, Any]]) -> None:
        """Teacher of a shipped name or a file, drawing at that resolution what those controls set.

        Raises:
            WeightsError: no such weights, or a file that cannot be them, or that no installed engine can run.
            PluginError: they need a plugin that is not installed.
            TeacherError: they have other controls.
        """
        file = find_weights(weights)
        self._loaded, self.resolution = load_plugins(file), resolution
        wanted = [[control["name"], control["version"]] for control in controls]
        known = [[control["name"], control["version"]] for control in self._loaded.card["controls"]]
        if known != wanted:
            raise TeacherError(f"train.teacher: expected weights whose controls are {wanted}, got {known} in {weights}")
        self._engine = start_engine(self._loaded, file, teacher_engine(), threads=1, exact=True)
        cells = Camera(resolution, resolution).frame_coordinates(step=self._loaded.config.unshuffle)
        self._encoding = self._loaded.encoder.encode(*cells)

    def picture(self, cloud: np.ndarray, scene: SceneDescription, settings: np.ndarray, side: int) -> np.ndarray:
        """Picture (side, side, 4) float32 of a placed cloud (N, 3) with settings (S,): colour times alpha, alpha."""
        camera = Camera(self.resolution, self.resolution, scene.elevation)
        buffers = draw_buffers(cloud, camera, scene, self._loaded.zbuffer, self._loaded.gbuffer)
        drawn = straight_bytes(self._engine.draw(buffers[None], self._encoding, settings[None])[0])
        return premultiplied_from_straight(shrink(unit_from_bytes(drawn), self.resolution // side))
