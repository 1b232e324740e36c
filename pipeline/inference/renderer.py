"""Trained weights ready to render placed clouds: buffers in, network, compositing, a straight RGBA image out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from pathlib import Path
from threading import local

import numpy as np

from z2p_core.camera import DEFAULT_ELEVATION, Camera
from z2p_core.camera_placement.placed_camera import PlacedCamera, reaches_border, widened
from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import (
    Condition,
    Control,
    Engine,
    GBuffer,
    PointColors,
    SettingError,
    Slider,
    Value,
    ZBuffer,
)
from z2p_core.native import to_straight_rgba8
from z2p_core.network.crop_window import crop_window
from z2p_core.network.exit_guard import inside_engine
from z2p_core.parallel import parallel_rows
from z2p_core.scene import SceneDescription
from z2p_core.settings import apply_controls, settings_vector
from z2p_core.shading.demodulation import apply_relative_radiance, reduce_light
from z2p_core.shading.textured_light import neutral_albedo
from z2p_renderer.pipeline.inference.adaptive_resolution import placed_render_size, render_size, upsampled
from z2p_renderer.pipeline.inference.engine_selection import start_engine
from z2p_renderer.pipeline.inference.input_buffers import draw_textured_buffers
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.storage.models.checkpoints import find_weights
from z2p_renderer.storage.results.fingerprints import file_digest

BORDER_PIXELS = 32
"""Pixels around a picture that are drawn and cut off again where the cloud goes on beyond it."""


class Renderer:
    """A trained network with its z-buffer, G-buffer, encoder and controls. Several threads may share one."""

    def __init__(
        self, weights: str | Path, threads: int | None = None, engine: str | None = None, lazy: bool = False
    ) -> None:
        """Load weights, a shipped name or a file.

        Args:
            threads: the most threads that the engine may use; None for one a core.
            engine: name of the engine that runs the network; None for the first installed one that can.
            lazy: start the engine with the first image instead of now.

        Raises:
            WeightsError: there are no such weights, the file is damaged, or no installed engine can run them.
            PluginError: a plugin that they need, or the engine, is not installed or fails to load.
        """
        self._file = file = find_weights(weights)
        self._loaded = load_plugins(file)
        self._start_engine = partial(start_engine, self._loaded, file, engine, threads)
        self._last_encoding: tuple[tuple[int, int], np.ndarray] = ((0, 0), np.empty(0, np.float32))
        self._thread_memory = local()
        if not lazy:
            self.start()

    def start(self) -> None:
        """Start the engine, if it does not run yet."""
        self._engine  # noqa: B018 - a cached property

    @cached_property
    def _engine(self) -> Engine:
        """The running engine, started at its first use."""
        return self._start_engine()

    @property
    def engine(self) -> str:
        """Name of the engine that runs the network."""
        return self._engine.name

    @cached_property
    def weights(self) -> dict[str, str]:
        """Name of the weights, and sha256 of their file."""
        return {"name": self._file.stem, "sha256": file_digest(self._file)}

    @property
    def controls(self) -> dict[str, Control]:
        """The controls that the weights carry, in the order of the settings vector."""
        return self._loaded.controls

    @property
    def gbuffer(self) -> GBuffer:
        """The G-buffer that the weights were trained with."""
        return self._loaded.gbuffer

    @property
    def zbuffer(self) -> ZBuffer:
        """The z-buffer that the weights were trained with."""
        return self._loaded.zbuffer

    @property
    def fixed_elevation(self) -> float | None:
        """The only camera elevation, in degrees, that the weights can render; None if it is one of their controls."""
        if "elevation" in self.controls:
            return None
        fixed = self._loaded.card.get("fixed_elevation")
        return DEFAULT_ELEVATION if fixed is None else float(fixed)

    @property
    def conditions(self) -> Sequence[Condition]:
        """The pictures that the network reads beside the buffers."""
        return self._loaded.conditions

    @property
    def draws_colors(self) -> bool:
        """Whether `render` takes colors of points: the weights have a control ``color``, their G-buffer textures."""
        return "color" in self.controls and self._loaded.gbuffer.draws_textures

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
        colors: PointColors | None = None,
        reduction: int | None = None,
    ) -> np.ndarray:
        """Image (height, width, 4) uint8, straight sRGB RGBA, of a placed cloud (N, 3) float32 in world units.

        `floor` is its height; None puts it under the lowest point. A sparse cloud is rendered smaller and upsampled: by
        the factor `reduction`, or None for one chosen by its spacing.
        `colors` are the surface's own, which take the place of the control ``color``; only for weights that
        `draw_colors`.
        """
        neutral = None if colors is None else neutral_albedo(colors.albedo)
        inputs, relative = self._inputs(cloud, with_neutral_color(values, neutral),
                                        *render_size(cloud, width, height, reduction), floor, colors)  # fmt: skip
        image = self.finish(inputs, relative, len(cloud), neutral, 1.0 if colors is None else colors.relight)
        return to_straight_rgba8(upsampled(image, width, height))

    def render_from(
        self, cloud: np.ndarray, camera: PlacedCamera, values: dict[str, Value] | None = None,
        floor: float | None = None, colors: PointColors | None = None, *, use_network: bool = True,
    ) -> np.ndarray:  # fmt: skip
        """The image (height, width, 4) uint8 of `render` as any camera sees the cloud; without the network if asked.

        Raises:
            SettingError: no network is to be used, and these weights' G-buffer makes no picture by itself.
        """
        if use_network and reaches_border(cloud, camera):  # near a picture's border the network sees too little
            wide = self._render_placed(cloud, widened(camera, BORDER_PIXELS), values, floor, colors, True)
            return np.ascontiguousarray(wide[BORDER_PIXELS:-BORDER_PIXELS, BORDER_PIXELS:-BORDER_PIXELS])
        return self._render_placed(cloud, camera, values, floor, colors, use_network)

    def _render_placed(
        self, cloud: np.ndarray, camera: PlacedCamera, values: dict[str, Value] | None, floor: float | None,
        colors: PointColors | None, use_network: bool,
    ) -> np.ndarray:  # fmt: skip
        """As `render_from`, up to the border of the network's picture."""
        size = placed_render_size(cloud, camera) if use_network else (camera.width, camera.height)
        neutral = None if colors is None else neutral_albedo(colors.albedo)
        inputs, relative = self._inputs(cloud, with_neutral_color(values, neutral), *size, floor, colors, camera)
        relight = 1.0 if colors is None else colors.relight
        image = self.finish(inputs, relative, len(cloud), neutral, relight, use_network)
        return to_straight_rgba8(upsampled(image, camera.width, camera.height))

    def finish(
        self, inputs: tuple[np.ndarray, np.ndarray, np.ndarray], relative: np.ndarray | None, points: int,
        neutral: np.ndarray | None, relight: float, use_network: bool = True,
    ) -> np.ndarray:  # fmt: skip
        """The image (4, H, W) float32, premultiplied sRGB and alpha, of the network's `inputs`, for so many points.

        `relative` (4, H, W) is the relative radiance of a surface with colors of its own, `neutral` (3,) the linear
        color in which the network renders it.
        """
        buffers, encoding, settings = inputs
        first = self._loaded.zbuffer.channels
        features = buffers[0, first : first + self._loaded.gbuffer.channels]
        if use_network:
            image = self._run_network(buffers, features, encoding, settings, points)
            self._loaded.gbuffer.reconcile(image, features, points)
        else:
            image = self._rough_picture(features)
        if neutral is not None and relative is not None:
            if relight < 1:
                reduce_light(image, neutral, relative[3], relight)
            apply_relative_radiance(image, relative[:3], relative[3])
        return image

    def _rough_picture(self, features: np.ndarray) -> np.ndarray:
        """What the G-buffer's features (channels, H, W) show without the network: (4, H, W) premultiplied.

        Raises:
            SettingError: nothing.
        """
        rough = self._loaded.gbuffer.rough_picture(features)
        if rough is None:
            raise SettingError(f"the weights {self.weights['name']!r} do not know this camera, and their G-buffer "
                               "makes no picture by itself; choose others with --weights, or another camera")
        return np.require(rough, np.float32, ["C", "W"])

    def inputs(
        self,
        cloud: np.ndarray,
        values: dict[str, Value] | None = None,
        width: int = 512,
        height: int = 512,
        floor: float | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The network's inputs for that image: buffers, encoding and settings, as `Engine.run` takes them."""
        return self._inputs(cloud, values, width, height, floor, None)[0]

    def _inputs(
        self, cloud: np.ndarray, values: dict[str, Value] | None, width: int, height: int, floor: float | None,
        colors: PointColors | None, placed: PlacedCamera | None = None,
    ) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray | None]:  # fmt: skip
        """`inputs`, and the relative radiance (4, height, width) of a surface with colors of its own."""

        def draw(camera: Camera, scene: SceneDescription) -> tuple[np.ndarray, np.ndarray | None]:
            return draw_textured_buffers(
                cloud, colors, camera, scene, self._loaded.zbuffer, self._loaded.gbuffer, self._loaded.conditions
            )

        return self.inputs_from(draw, values, width, height, floor, placed)

    def inputs_from(
        self, draw: Callable[[Camera, SceneDescription], tuple[np.ndarray, np.ndarray | None]],
        values: dict[str, Value] | None, width: int, height: int, floor: float | None,
        placed: PlacedCamera | None = None,
    ) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray | None]:  # fmt: skip
        """The network's inputs with the buffers that `draw` makes of a camera and a scene, and what else that gives.

        Values beyond a control's range are drawn as they are, and the network reads the nearest one in the range.
        `placed` is a camera that takes the place of the usual one at the elevation of the values.
        """
        scene = SceneDescription(floor=floor)
        if self.fixed_elevation is not None:
            scene.elevation = self.fixed_elevation
        settings = self.settings(values)
        apply_controls(settings, self.controls, scene)
        if placed is None:
            camera, encoding = Camera(width, height, scene.elevation), self._encoding(width, height)
        else:
            camera = placed.resized(width, height)
            encoding = self._loaded.encoder.encode(*camera.frame_coordinates(step=self._loaded.config.unshuffle))
        buffers, relative = draw(camera, scene)
        read = {name: clamped(value, self.controls[name].slider) for name, value in settings.items()}
        return (buffers[None], encoding, settings_vector(read, self.controls)[None]), relative

    def _encoding(self, width: int, height: int) -> np.ndarray:
        """The encoder's features (E, h, w) for an image of that size. The last are kept: most images have one size."""
        size, encoding = self._last_encoding
        if size != (width, height):
            cells = Camera(width, height).frame_coordinates(step=self._loaded.config.unshuffle)
            encoding = self._loaded.encoder.encode(*cells)
            self._last_encoding = (width, height), encoding
        return encoding

    def _run_network(
        self, buffers: np.ndarray, features: np.ndarray, encoding: np.ndarray, settings: np.ndarray, points: int
    ) -> np.ndarray:
        """The network's image (4, H, W) float32: premultiplied color and alpha.

        Weights that were trained on crops run only on a window around the cloud; the G-buffer draws the rest.
        `features` (channels, H, W) are the G-buffer's part of `buffers`, of a cloud of so many points.
        """
        outside = self._loaded.gbuffer.elsewhere(features, points) if self._loaded.windows else None
        if outside is None:
            with inside_engine():
                picture = self._engine.draw(buffers, encoding, settings)[0]
            return np.require(picture, np.float32, ["C", "W"])
        mask, image = outside
        cell = self._loaded.config.unshuffle
        window = crop_window(mask > 0, self._loaded.config.stride, cell)
        cells = [slice(side.start // cell, -(-side.stop // cell)) for side in window]
        inputs = self._contiguous(buffers[:, :, *window]), np.ascontiguousarray(encoding[:, *cells]), settings
        with inside_engine():
            image[:, *window] = self._engine.draw(*inputs)[0]
        return image

    def _contiguous(self, window: np.ndarray) -> np.ndarray:
        """A contiguous copy of a window (B, C, h, w), in memory that this thread keeps: allocating costs 5 % more."""
        memory: np.ndarray = getattr(self._thread_memory, "array", window[:0])
        if memory.size < window.size:
            memory = self._thread_memory.array = np.empty(window.size, np.float32)
        copy = memory.ravel()[: window.size].reshape(window.shape)

        def copy_channels(begin: int, end: int) -> None:
            copy[:, begin:end] = window[:, begin:end]

        parallel_rows(copy_channels, window.shape[1], smallest=2, parts=2)  # half of the channels on each core
        return copy


def with_neutral_color(values: dict[str, Value] | None, neutral: np.ndarray | None) -> dict[str, Value]:
    """Values of controls, with that linear color (3,), if any, as the control ``color``, in sRGB."""
    if neutral is None:
        return values or {}
    return {**(values or {}), "color": tuple(round(channel, 5) for channel in srgb_from_linear(neutral).tolist())}


def clamped(value: Value, slider: Slider) -> Value:
    """The value in the slider's range that is nearest to a value."""
    ends = zip(value, slider.low, slider.high, strict=True)
    return tuple(min(max(number, low), high) for number, low, high in ends)
