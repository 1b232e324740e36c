"""Cameras of a nerfstudio transforms.json, or of instant-ngp's and Blender's scenes, which have the same keys.

https://docs.nerf.studio/quickstart/data_conventions.html: a transform_matrix goes from the camera to the world; camera
axes are OpenGL's: +X right, +Y up, +Z back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from z2p_core.errors.value_limits import describe_value
from z2p_core.interfaces import SettingError
from z2p_core.pinhole import PinholeCamera, pinhole_camera

OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0])
SCALE_TOLERANCE = 1e-2
"""Largest deviation of a pose's axes from right angles and from a common length."""
DISTORTION_KEYS = ("k1", "k2", "k3", "k4", "p1", "p2")


def is_transforms(data: Any) -> bool:
    """Whether JSON data looks like a transforms.json."""
    return isinstance(data, Mapping) and isinstance(data.get("frames"), list)


def parse_transforms(data: Mapping[str, Any]) -> tuple[list[PinholeCamera], str]:
    """The cameras of the frames, in the order of the file, and what was left out, in words.

    Poses are taken as they stand, in the coordinates of the cloud that ``ply_file_path`` names.

    Raises:
        SettingError: a frame has no pose or no size, or is no pinhole camera.
    """
    model = data.get("camera_model", "OPENCV")
    if model not in ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "perspective"):
        raise SettingError(
            f"expected pinhole cameras, got the camera_model {describe_value(model)}; undistort the images first"
        )
    cameras, is_distorted = [], False
    for number, frame in enumerate(data["frames"]):
        if not isinstance(frame, Mapping):
            raise SettingError(f"frame {number}: expected an object, got {describe_value(frame)}")
        settings = {**data, **frame}
        try:
            cameras.append(_camera(settings, number))
            is_distorted |= any(bool(settings.get(key)) for key in DISTORTION_KEYS)
        except (TypeError, ValueError, KeyError) as error:
            reason = str(error).removeprefix("camera: ") if isinstance(error, SettingError) else f"{error!r} is missing"
            raise SettingError(f"frame {number}: {reason}") from error
    return cameras, "lens distortion is left out: undistort the photographs to compare them" if is_distorted else ""


def _camera(settings: Mapping[str, Any], number: int) -> PinholeCamera:
    pose = np.array(settings["transform_matrix"], dtype=np.float64)
    if pose.shape not in ((4, 4), (3, 4)) or not np.isfinite(pose).all():
        raise SettingError(f"expected a transform_matrix of 4 x 4 numbers, got {describe_value(pose.tolist())}")
    axes = pose[:3, :3] / np.maximum(np.linalg.norm(pose[:3, :3], axis=0), 1e-12)
    if np.abs(axes.T @ axes - np.eye(3)).max() > SCALE_TOLERANCE:
        raise SettingError("expected a transform_matrix with axes at right angles")
    left, _, right = np.linalg.svd(axes)
    rotation = OPENGL_TO_OPENCV @ (left @ right).T
    width, height = (int(settings[key]) if key in settings else 0 for key in ("w", "h"))
    if not (width and height):
        raise SettingError("expected the pictures' width and height as w and h")
    focal_x = _focal(settings, "fl_x", "camera_angle_x", width)
    focal_y = _focal(settings, "fl_y", "camera_angle_y", height) or focal_x
    focal_x = focal_x or focal_y
    if not focal_x:
        raise SettingError("expected a focal length as fl_x, or camera_angle_x")
    center = (float(settings.get("cx", width / 2)), float(settings.get("cy", height / 2)))
    intrinsics = [[focal_x, 0, center[0]], [0, focal_y, center[1]], [0, 0, 1]]
    name = str(settings.get("file_path", f"{number:04d}"))
    return pinhole_camera(intrinsics, rotation, -rotation @ pose[:3, 3], (width, height), name=name)


def _focal(settings: Mapping[str, Any], key: str, angle_key: str, side: int) -> float:
    """A focal length in pixels, by its key or by the angle in radians across a side; 0 if neither is there."""
    if settings.get(key):
        return float(settings[key])
    angle = settings.get(angle_key)
    return side / 2 / math.tan(float(angle) / 2) if angle else 0.0
