"""The usual camera in the data's units: that of a picture without a camera of its own, as a pinhole camera."""

from __future__ import annotations

from typing import cast

import numpy as np

from z2p_core.camera import Camera
from z2p_core.camera_placement.zoomed_camera import zoomed_camera
from z2p_core.pinhole import Matrix, PinholeCamera
from z2p_core.placement.viewpoint import Viewpoint


def usual_pinhole(viewpoint: Viewpoint, width: int, height: int, elevation: float) -> PinholeCamera:
    """The camera at an elevation in degrees, in the data's units, for a picture of that size in pixels."""
    camera: Camera = Camera(width, height, elevation)
    if viewpoint.zoom:
        camera = zoomed_camera(width, height, elevation, viewpoint.zoom)
    rotation = camera.rotation @ np.array(viewpoint.rotation)
    position = viewpoint.unplace(camera.position[None])[0]
    rows = cast(Matrix, tuple(tuple(row) for row in rotation.tolist()))
    x, y, z = (-rotation @ position).tolist()
    return PinholeCamera(width, height, camera.focal_lengths, camera.principal_point, rows, (x, y, z))
