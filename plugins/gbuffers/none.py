"""No G-buffer: the network reads the z-buffer alone, as in the paper."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera
from z2p_core.interfaces import GBuffer
from z2p_core.scene import SceneDescription


class NoGBuffer(GBuffer):
    """No channels."""

    name = "none"
    version = "1"
    channels = 0

    def draw(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        return np.empty((0, camera.height, camera.width), dtype=np.float32)
