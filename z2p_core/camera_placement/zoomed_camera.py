"""The usual camera with a part of its frame enlarged, as a placed camera."""

from __future__ import annotations

from typing import cast

from z2p_core.camera import Camera
from z2p_core.camera_placement.placed_camera import PlacedCamera, Rows
from z2p_core.placement.zoom import Zoom


def zoomed_camera(width: int, height: int, elevation: float, zoom: Zoom) -> PlacedCamera:
    """The camera of a picture of that size in pixels, at an elevation in degrees."""
    usual, (right, up) = Camera(width, height, elevation), zoom.pan
    (fx, fy), (cx, cy), side = usual.focal_lengths, usual.principal_point, min(width, height)
    rows = cast(Rows, tuple(tuple(row) for row in usual.rotation.tolist()))
    x, y, z = usual.position.tolist()
    return PlacedCamera(width, height, elevation, (fx * zoom.factor, fy * zoom.factor),
                        (cx + right * side, cy - up * side), rows, (x, y, z))  # fmt: skip
