"""What the network reads of a cloud: the z-buffer's channels, then the G-buffer's."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera
from z2p_core.interfaces import GBuffer, ZBuffer
from z2p_core.parallel import run_async
from z2p_core.scene import SceneDescription


def draw_buffers(
    cloud: np.ndarray, camera: Camera, scene: SceneDescription, zbuffer: ZBuffer, gbuffer: GBuffer
) -> np.ndarray:
    """Picture (channels, height, width) float32 of a cloud (N, 3) float32 that is placed in the scene already."""
    picture = np.empty((zbuffer.channels + gbuffer.channels, camera.height, camera.width), dtype=np.float32)
    splats = run_async(zbuffer.draw_into, picture[: zbuffer.channels], cloud, camera)
    gbuffer.draw_into(picture[zbuffer.channels :], cloud, camera, scene)
    splats.result()
    return picture
