"""From a cloud to a picture: places the cloud in the world and runs the network."""

from __future__ import annotations

from functools import cached_property, partial
from pathlib import Path
from threading import local

import numpy as np

from z2p_core.camera import DEFAULT_ELEVATION, Camera, turn
from z2p_core.interfaces import Control, Engine, Value
from z2p_core.native import straight_bytes
from z2p_core.network.crop_window import window_of
from z2p_core.parallel import parallel_rows
from z2p_core.placement.viewpoint import frame_points
from z2p_core.scene import SceneDescription
from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_renderer.pipeline.inference.adaptive_resolution import render_size, upsampled
from z2p_renderer.pipeline.inference.engine_selection import start_engine
from z2p_renderer.pipeline.inference.input_buffers import draw_buffers
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.storage.models.checkpoints import find_weights
from z2p_renderer.storage.results.fingerprints import file_digest


class Renderer:
    """Trained network with its z-buffer, encoder and controls, ready to draw placed clouds. Threads may share one."""

    def __init__(
        self, weights: str | Path, threads: int | None = None, engine: str | None = None, lazy: bool = False
    ) -> None:
        """Renderer of `weights`, a shipped name or a file, on at most so many threads.

        `engine` names what runs the network; by default the first installed one that can. It starts now, or, if
        `lazy`, with the first picture.

        Raises:
            WeightsError: no such weights, or a file that cannot be them, or that no installed engine can run.
            PluginError: they need a plugin that is not installed or fails to load; or the engine is.
        """
        self._file = file = find_weights(weights)
        self._loaded = load_plugins(file)
        self._start = partial(start_engine, self._loaded, file, engine, threads)
        self._last_encoding: tuple[tuple[int, int], np.ndarray] = ((0, 0), np.empty(0, np.float32))
        self._kept = local()
        if not lazy:
            self._engine  # noqa: B018 - started at once, so that it fails at once

    @cached_property
    def _engine(self) -> Engine:
        return self._start()

    @property
    def engine(self) -> str:
        """Name of the engine that runs the network."""
        return self._engine.name

    @cached_property
    def weights(self) -> dict[str, str]:
        """Name of the weights, and sha256 of their file."""
        return {"name": self._file.stem, "sha256": file_digest(self._file)}

    @property
    def sole_weights(self) -> str | None:
        """sha256 of the weights that draw every cloud; None where clouds choose, as in `pipeline.inference.weight_selection`."""
        digest: str = self.weights["sha256"]
        return digest

    def suited(self, cloud: np.ndarray) -> tuple[Renderer, str]:
        """The renderer for a placed cloud (N, 3) float32, this one, and why it is another; see `pipeline.inference.weight_selection`."""
        return self, ""

    @property
    def controls(self) -> dict[str, Control]:
        """The controls that the weights carry, in the order of the settings vector."""
        return self._loaded.controls

    @property
    def fixed_elevation(self) -> float | None:
        """The only camera elevation the weights know, degrees; None when elevation is one of their controls."""
        if "elevation" in self.controls:
            return None
        fixed = self._loaded.card.get("fixed_elevation")
        return DEFAULT_ELEVATION if fixed is None else float(fixed)

    def settings(self, values: dict[str, Value] | None = None) -> dict[str, Value]:
        """Every control's value: the given one, or its slider's default."""
        values = values or {}
        return {name: values.get(name, control.slider.default) for name, control in self.controls.items()}

    def render(
        self,
        cloud: np.ndarray,
        values: dict[str, Value] | None = None,
        width: int = 512,
        height: int = 512,
        floor: float | None = None,
    ) -> np.ndarray:
        """Picture (height, width, 4) uint8, straight sRGB RGBA, of a placed cloud (N, 3) float32 in world units.

        The floor lies at that height; None puts it under the lowest point. Of a sparse cloud a smaller picture is drawn
        and enlarged.
        """
        buffers, encoding, settings = self.inputs(cloud, values, *render_size(cloud, width, height), floor)
        features = buffers[0, self._loaded.zbuffer.channels :]
        drawn = self._drawn(buffers, features, encoding, settings, len(cloud))
        self._loaded.gbuffer.reconcile(drawn, features, len(cloud))
        return straight_bytes(upsampled(drawn, width, height))

    def _drawn(
        self, buffers: np.ndarray, features: np.ndarray, encoding: np.ndarray, settings: np.ndarray, points: int
    ) -> np.ndarray:
        """The network's picture (4, H, W) of these inputs, the G-buffer's features of so many points among them."""
        beside = self._loaded.gbuffer.elsewhere(features, points) if self._loaded.windows else None
        if beside is None:
            return np.require(self._engine.draw(buffers, encoding, settings)[0], np.float32, ["C", "W"])
        shown, drawn = beside
        cell = self._loaded.config.unshuffle
        window = window_of(shown > 0, self._loaded.config.stride, cell)
        blocks = [slice(side.start // cell, -(-side.stop // cell)) for side in window]
        inside = self._copied(buffers[:, :, *window]), np.ascontiguousarray(encoding[:, *blocks]), settings
        drawn[:, *window] = self._engine.draw(*inside)[0]
        return drawn

    def _copied(self, window: np.ndarray) -> np.ndarray:
        """The window (B, C, h, w) without gaps, where this thread's last one was: new memory costs a twentieth more."""
        kept: np.ndarray = getattr(self._kept, "room", window[:0])
        if kept.size < window.size:
            kept = self._kept.room = np.empty(window.size, np.float32)
        copy = kept.ravel()[: window.size].reshape(window.shape)

        def fill(begin: int, end: int) -> None:
            copy[:, begin:end] = window[:, begin:end]

        parallel_rows(fill, window.shape[1], smallest=2, parts=2)  # half of the channels on each core
        return copy

    def inputs(
        self,
        cloud: np.ndarray,
        values: dict[str, Value] | None = None,
        width: int = 512,
        height: int = 512,
        floor: float | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the engine is run on for that picture: buffers, encoding and settings, as `Engine.run` takes them."""
        scene = SceneDescription(floor=floor)
        if self.fixed_elevation is not None:
            scene.elevation = self.fixed_elevation
        encoded: list[float] = []
        for name, value in self.settings(values).items():
            self.controls[name].apply(value, scene)
            encoded.extend(self.controls[name].encode(value))
        camera = Camera(width, height, scene.elevation)
        buffers = draw_buffers(cloud, camera, scene, self._loaded.zbuffer, self._loaded.gbuffer)
        return buffers[None], self._encoding(width, height), np.array([encoded], dtype=np.float32)

    def _encoding(self, width: int, height: int) -> np.ndarray:
        """The encoder's features (E, h, w) of a picture of that size; the last are kept, as most are of one size."""
        size, encoding = self._last_encoding
        if size != (width, height):
            cells = Camera(width, height).frame_coordinates(step=self._loaded.config.unshuffle)
            encoding = self._loaded.encoder.encode(*cells)
            self._last_encoding = (width, height), encoding
        return encoding


def place_cloud(points: np.ndarray, up: str | np.ndarray = "+Z", azimuth: float = 0.0) -> np.ndarray:
    """Cloud (N, 3) float32 in world units: `up` turned to +Z, in the unit sphere, turned by `azimuth` degrees about Z.

    `points` (N, 3) float64, finite, in any unit; centred and scaled in float64, so UTM coordinates keep their digits.
    `up` names an axis of the data, or is the rotation (3, 3) that sets the data upright.

    Raises:
        ScanError: there is no extent to scale: no points, or all in one place.
    """
    upright = np.asarray(UP_ROTATIONS[up] if isinstance(up, str) else up, dtype=np.float64)
    return frame_points(points, turn(azimuth) @ upright, DEFAULT_ELEVATION).place(points)
