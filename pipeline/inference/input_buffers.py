"""What the network reads of a cloud: the channels of the z-buffer, then the G-buffer's, then those of conditions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from z2p_core.camera import Camera, turn
from z2p_core.interfaces import ColoredCloud, Condition, GBuffer, PointColors, PreparedCloud, ZBuffer
from z2p_core.parallel import run_async
from z2p_core.scene import SceneDescription
from z2p_core.shading.light_transport import base_color


def draw_buffers(
    cloud: np.ndarray, camera: Camera, scene: SceneDescription, zbuffer: ZBuffer, gbuffer: GBuffer
) -> np.ndarray:  # fmt: skip
    """Buffers (channels, height, width) float32 of a cloud (N, 3) float32 that is placed in the scene already."""
    return draw_textured_buffers(cloud, None, camera, scene, zbuffer, gbuffer)[0]


def draw_textured_buffers(
    cloud: np.ndarray, colors: PointColors | None, camera: Camera, scene: SceneDescription, zbuffer: ZBuffer,
    gbuffer: GBuffer, conditions: Sequence[Condition] = (),
) -> tuple[np.ndarray, np.ndarray | None]:  # fmt: skip
    """The same buffers with those of conditions, and with colors what `GBuffer.draw_textured_into` returns.

    Conditions show a cloud without colors in the scene's base color; without both, the second result is None.
    """
    if conditions and colors is None:
        colors = PointColors(cloud, base_color(scene)[None].repeat(len(cloud), axis=0))
    channels = [zbuffer.channels, gbuffer.channels, *(condition.channels for condition in conditions)]
    buffers = np.empty((sum(channels), camera.height, camera.width), dtype=np.float32)
    first, features, *pictures = np.split(buffers, np.cumsum(channels)[:-1])
    splats, relative = run_async(zbuffer.draw_into, first, cloud, camera), None
    if colors is None:
        gbuffer.draw_into(features, cloud, camera, scene)
    else:
        relative = gbuffer.draw_textured_into(features, cloud, colors, camera, scene)
        colored = ColoredCloud(cloud, colors, base_color(scene), relative)
        for condition, picture in zip(conditions, pictures, strict=True):
            condition.draw_into(picture, colored, camera, scene)
    splats.result()
    return buffers, relative


def draw_prepared_buffers(
    cloud: np.ndarray, prepared: PreparedCloud, azimuth: float, camera: Camera, scene: SceneDescription,
    zbuffer: ZBuffer, gbuffer: GBuffer,
) -> tuple[np.ndarray, np.ndarray | None]:  # fmt: skip
    """What `draw_textured_buffers` gives for the cloud turned by `azimuth` degrees, with what `prepared` has kept."""
    buffers = np.empty((zbuffer.channels + gbuffer.channels, camera.height, camera.width), dtype=np.float32)
    turned = cloud @ turn(azimuth).astype(np.float32).T if azimuth else cloud
    splats = run_async(zbuffer.draw_into, buffers[: zbuffer.channels], turned, camera)
    relative = prepared.draw_into(buffers[zbuffer.channels :], azimuth, camera, scene)
    splats.result()
    return buffers, relative
