"""A placed cloud for many images: what they share is computed once, see `z2p_core.interfaces.GBuffer.prepare`."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from z2p_core.camera import Camera, turn
from z2p_core.interfaces import PointColors, Value
from z2p_core.native import to_straight_rgba8
from z2p_core.scene import SceneDescription
from z2p_core.shading.textured_light import neutral_albedo
from z2p_renderer.pipeline.inference.adaptive_resolution import render_size, upsampled
from z2p_renderer.pipeline.inference.input_buffers import draw_prepared_buffers, draw_textured_buffers
from z2p_renderer.pipeline.inference.renderer import with_neutral_color

if TYPE_CHECKING:
    from z2p_renderer.pipeline.inference.renderer import Renderer


class PreparedRender:
    """A placed cloud that one renderer draws again and again. Several threads may share one.

    Images are those of `Renderer.render` of the turned cloud, but for noise of what is sampled along fixed axes and on
    the floor's grid, which then lie otherwise to the object; an unturned cloud gives the same bytes.
    """

    def __init__(
        self, renderer: Renderer, cloud: np.ndarray, floor: float | None = None, colors: PointColors | None = None
    ) -> None:  # fmt: skip
        self._renderer, self._cloud, self._floor = renderer, cloud, floor
        self._colors = colors
        self._neutral = None if colors is None else neutral_albedo(colors.albedo)
        self._sizes: dict[tuple[int, int], tuple[int, int]] = {}
        self._prepared = renderer.gbuffer.prepare(cloud, colors)

    def recolored(self, colors: PointColors | None) -> PreparedRender:
        """The same cloud in other colors, or in one (None); surface and light are kept."""
        other = copy(self)
        other._colors = colors
        other._neutral = None if colors is None else neutral_albedo(colors.albedo)
        other._prepared = self._prepared.recolored(colors)
        return other

    def render(
        self, values: dict[str, Value] | None = None, width: int = 512, height: int = 512, azimuth: float = 0.0,
        relight: float | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Image (height, width, 4) uint8, straight sRGB RGBA, of the cloud turned by `azimuth` degrees.

        Args:
            values: of the controls, as for `Renderer.render`; the light's azimuth is relative to the camera and may
                be any angle here. `fixed_to_object` gives that of a light that stays where it is around the object.
            width: of the image, in pixels.
            height: of the image, in pixels.
            azimuth: about the vertical axis, counter-clockwise from above.
            relight: `PointColors.relight`; None for that of the colors.
        """
        renderer, gbuffer = self._renderer, self._renderer.gbuffer

        def draw(camera: Camera, scene: SceneDescription) -> tuple[np.ndarray, np.ndarray | None]:
            if renderer.conditions:  # which are drawn of the turned cloud
                rotation = turn(azimuth).astype(np.float32).T
                colors = self._colors and replace(self._colors, points=self._colors.points @ rotation)
                return draw_textured_buffers(
                    self._cloud @ rotation, colors, camera, scene, renderer.zbuffer, gbuffer, renderer.conditions
                )
            return draw_prepared_buffers(self._cloud, self._prepared, azimuth, camera, scene, renderer.zbuffer, gbuffer)

        if (width, height) not in self._sizes:
            self._sizes[width, height] = render_size(self._cloud, width, height)
        inputs, relative = renderer.inputs_from(
            draw, with_neutral_color(values, self._neutral), *self._sizes[width, height], self._floor
        )
        if relight is None:
            relight = 1.0 if self._colors is None else self._colors.relight
        image = renderer.finish(inputs, relative, len(self._cloud), self._neutral, relight)
        return to_straight_rgba8(upsampled(image, width, height))


def fixed_to_object(light: Value, azimuth: float) -> Value:
    """A light (radius, azimuth, elevation) relative to the camera, of an object that is turned by `azimuth` degrees.

    `light` is the same light before the object was turned, with which it turns. Its azimuth is in [-180, 180).
    """
    radius, around, elevation = light
    return radius, (around + azimuth + 180.0) % 360.0 - 180.0, elevation
