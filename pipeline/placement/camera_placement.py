"""Places a scan before a camera of the user's: upright, in the unit sphere, turned so that the camera stands in front.

The light is bound to the camera's side, as for every picture; the camera itself stays wherever it stands.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from z2p_core.camera import DISTANCE, turn
from z2p_core.camera_placement.familiar_views import FIXED_ELEVATION_TOLERANCE_DEGREES, unfamiliar_view
from z2p_core.camera_placement.placed_camera import PlacedCamera, place_camera
from z2p_core.interfaces import ScanError, SettingError
from z2p_core.pinhole import AnyCamera, LookAt, PinholeCamera, aimed_camera, check_drawable_size, look_at_camera
from z2p_core.placement.viewpoint import Viewpoint, frame_points
from z2p_core.scene import SIDE_LIMITS

MAX_DISTANCE_RADII = 10_000.0
"""Distance of a pinhole camera, in the cloud's radius, beyond which float32 depths tell no surfaces apart."""
MIN_HORIZONTAL_SHARE = 1e-3
"""Horizontal part of a direction below which it counts as vertical."""
FIT_MARGIN = 0.05
"""Free border of an orthographic picture whose size follows from the cloud, as a share of its longer side."""


def camera_viewpoint(
    points: np.ndarray, up: np.ndarray, wish: AnyCamera, direction: np.ndarray
) -> tuple[Viewpoint, PinholeCamera]:
    """The viewpoint that places points (N, 3) before the camera, and the camera in the data's units.

    `up` (3, 3) turns the data upright; `direction` (3,) points in the upright axes from the cloud to a camera that is
    wished for without a place.

    Raises:
        ScanError: the points have no extent.
        SettingError: the camera cannot be, or its picture is too large.
    """
    frame = frame_points(points, up, 0.0)
    middle = np.array(frame.centre)
    camera = wish if isinstance(wish, PinholeCamera) else _resolve(wish, points, frame, up, direction)
    check_drawable_size(camera)
    toward = -up @ np.array(camera.rotation[2])
    station = up @ (camera.position - middle) / frame.radius
    if not camera.orthographic and np.linalg.norm(station) > 1 and _azimuth(station) is not None:
        toward = station
    azimuth = _azimuth(toward)
    if azimuth is None:  # straight down: the picture's lower border is in front
        azimuth = _azimuth(up @ np.array(camera.rotation[1])) or 0.0
    rotation = turn(-90.0 - azimuth) @ up
    rows = tuple(tuple(row) for row in rotation.tolist())
    viewpoint = Viewpoint(frame.centre, frame.radius, rows, 0.0)
    return replace(viewpoint, elevation=place_camera(camera, viewpoint).elevation), camera


def check_visible(cloud: np.ndarray, camera: PlacedCamera) -> None:
    """
    Raises:
        ScanError: the camera sees nothing of the placed cloud (N, 3).
    """
    if not camera.orthographic and camera.origin_distance > MAX_DISTANCE_RADII:
        raise ScanError(f"lies {camera.origin_distance:.3g} times its own radius from the camera, too far for a "
                        f"picture (at most {MAX_DISTANCE_RADII:g}); check the units of both, or use an orthographic "
                        "camera")
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels, depth = camera.project(cloud.astype(np.float64))
    before = depth > camera.near_plane if not camera.orthographic else np.ones(len(cloud), bool)
    if not before.any():
        raise ScanError("lies behind the camera as a whole; check that R and t go from the data to the camera, and "
                        "that the camera's axes are OpenCV's (+Z forward)")
    inside = before & (pixels >= 0).all(1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
    if not inside.any():
        column, row = np.median(pixels[before], axis=0)
        raise ScanError(f"lies outside the camera's picture of {camera.width} x {camera.height} pixels, around column "
                        f"{column:.0f}, row {row:.0f}; turn the camera to it")


def check_zoom(cloud: np.ndarray, camera: PlacedCamera) -> None:
    """
    Raises:
        ScanError: the usual camera, zoomed and panned, sees nothing of the placed cloud (N, 3).
    """
    pixels, depth = camera.project(cloud.astype(np.float64))
    inside = (depth > camera.near_plane) & (pixels >= 0).all(1) & (pixels < (camera.width, camera.height)).all(1)
    if not inside.any():
        raise ScanError("lies beside the part of the frame that is shown; choose a smaller zoom or pan")


def unfamiliar_reason(
    cloud: np.ndarray, camera: PlacedCamera, elevation: float, elevation_range: tuple[float, float] | None
) -> str:
    """Why the network cannot draw the placed cloud (N, 3) for that camera, in words; empty if it can.

    `elevation` is the weights' own where they have no range of it.
    """
    reason = unfamiliar_view(camera, float(cloud[:, 2].min()))
    if reason or elevation_range is not None:
        return reason
    if abs(camera.elevation - elevation) > FIXED_ELEVATION_TOLERANCE_DEGREES:
        return f"the weights know only the elevation of {elevation:g} degrees"
    return ""


def _resolve(
    wish: LookAt, points: np.ndarray, frame: Viewpoint, up: np.ndarray, direction: np.ndarray
) -> PinholeCamera:
    """The camera that a wish stands for; an orthographic one without a size gets one that shows all points."""
    size, middle = wish.size or (1, 1), np.array(frame.centre)
    if wish.eye is not None:
        camera = look_at_camera(wish, size, middle, up[2])
    elif wish.pixels_per_unit is not None:
        target = middle if wish.target is None else np.array(wish.target)
        eye = target + DISTANCE * frame.radius * (up.T @ direction)
        upward = up[2] if wish.up is None else np.array(wish.up)
        camera = aimed_camera(eye, target, upward, size, wish.field_of_view, wish.pixels_per_unit)
    else:
        raise SettingError("camera: expected where it stands (look-from)")
    return camera if wish.size is not None or wish.pixels_per_unit is None else _sized(camera, points)


def _sized(camera: PinholeCamera, points: np.ndarray) -> PinholeCamera:
    """An orthographic camera with a picture that shows all points (N, 3), and a border.

    Raises:
        SettingError: it would be too large.
    """
    pixels, _ = camera.project(points)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    border = FIT_MARGIN * float((high - low).max())
    least, most = SIDE_LIMITS
    width, height = (max(least, math.ceil(side + 2 * border)) for side in (high - low).tolist())
    if max(width, height) > most:
        raise SettingError(f"the scale makes a picture of {width} x {height} pixels, and it can have {most} a side; "
                           f"choose a scale of at most {most / max(width, height):.3g} times that, or a lower dpi")
    x, y = ((np.array([width, height]) - low - high) / 2 + np.array(camera.center)).tolist()
    return replace(camera, width=width, height=height, center=(x, y))


def _azimuth(direction: np.ndarray) -> float | None:
    """Azimuth of a direction (3,) in degrees, counter-clockwise from +X; None if it is vertical."""
    horizontal = math.hypot(direction[0], direction[1])
    if horizontal <= MIN_HORIZONTAL_SHARE * float(np.linalg.norm(direction)):
        return None
    return math.degrees(math.atan2(direction[1], direction[0]))
