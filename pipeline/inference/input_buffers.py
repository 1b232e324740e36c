"""What the network reads of a cloud: the z-buffer's channels, then the G-buffer's."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera, turn
from z2p_core.interfaces import GBuffer, PointColors, PreparedCloud, ZBuffer
from z2p_core.parallel import run_async
from z2p_core.scene import SceneDescription


def draw_buffers(
    cloud: np.ndarray, camera: Camera, scene: SceneDescription, zbuffer: ZBuffer, gbuffer: GBuffer
) -> np.ndarray:  # fmt: skip
    """Buffers (channels, height, width) float32 of a cloud (N, 3) float32 that is placed in the scene already."""
    return draw_textured_buffers(cloud, None, camera, scene, zbuffer, gbuffer)[0]


def draw_textured_buffers(
    cloud: np.ndarray, colors: PointColors | None, camera: Camera, scene: SceneDescription, zbuffer: ZBuffer,
    gbuffer: GBuffer,
) -> tuple[np.ndarray, np.ndarray | None]:  # fmt: skip
    """The same buffers, and with colors what `GBuffer.draw_textured_into` returns; without, None."""
    buffers = np.empty((zbuffer.channels + gbuffer.channels, camera.height, camera.width), dtype=np.float32)
    splats = run_async(zbuffer.draw_into, buffers[: zbuffer.channels], cloud, camera)
    features, relative = buffers[zbuffer.channels :], None
    if colors is None:
        gbuffer.draw_into(features, cloud, camera, scene)
    else:
        relative = gbuffer.draw_textured_into(features, cloud, colors, camera, scene)
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
