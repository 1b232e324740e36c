"""Up axis and viewpoint of a cloud from the poses of the cameras that it was made from."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from z2p_core.interfaces import RawCloud

_MAX_AXIS_TILT_DEGREES, _MIN_MEAN_UP_LENGTH = 20.0, 0.5
"""Largest angle between the cameras' up direction and a coordinate axis that stands for it; and the least length of the
mean of the cameras' unit up vectors: a shorter mean says that the cameras were held in all orientations.
The second is also the least cosine between that mean and the up direction from the right vectors."""
_MIN_RIGHT_SPREAD = 0.2
"""Least second singular value, divided by sqrt(M), of M right vectors of cameras that span a horizontal plane."""
MAX_JSON_BYTES, _MAX_SEARCHED_FOLDERS = 1 << 26, 3
"""Larger camera files are not read; they are searched in this many folders, from that of the points upwards."""


def with_camera_hints(cloud: RawCloud, rotations: np.ndarray, positions: np.ndarray) -> RawCloud:
    """Returns the cloud with the up axis and viewpoint of its cameras; with M = 0, the cloud as it is.

    `rotations` (M, 3, 3) go from the cloud's axes to the OpenCV axes of each camera; `positions` (M, 3) are the camera
    positions in the cloud's axes.
    """
    if not len(positions):
        return cloud
    seen_from = positions[((positions - positions.mean(0)) ** 2).sum(1).argmin()]
    upward = _estimate_up(rotations)
    if upward is None:
        return replace(cloud, seen_from=seen_from)
    longest = int(np.abs(upward).argmax())
    axis = ("+" if upward[longest] > 0 else "-") + "XYZ"[longest]
    tilted = abs(float(upward[longest])) < np.cos(np.radians(_MAX_AXIS_TILT_DEGREES))
    return replace(cloud, up=axis, up_certain=True, up_reason=f"its {len(positions)} cameras stood so",
                   upward=upward if tilted else None, seen_from=seen_from)  # fmt: skip


def _estimate_up(rotations: np.ndarray) -> np.ndarray | None:
    """The unit up vector (3,) of cameras with rotations (M, 3, 3); None if they were held in all orientations.

    The mean of the cameras' own up vectors leans back when they look down. The direction perpendicular to all right
    vectors does not, so it is preferred, unless the cameras all look the same way and do not determine it.
    """
    mean = -rotations[:, 1].mean(0)
    length = float(np.linalg.norm(mean))
    if length < _MIN_MEAN_UP_LENGTH:
        return None
    spread, axes = np.linalg.svd(rotations[:, 0], full_matrices=True)[1:]
    level = axes[2]
    min_spread = _MIN_RIGHT_SPREAD * len(rotations) ** 0.5
    is_misaligned = abs(level @ mean) < _MIN_MEAN_UP_LENGTH * length
    if len(rotations) < 3 or spread[1] < min_spread or is_misaligned:
        return np.asarray(mean / length)
    return np.asarray(level if level @ mean > 0 else -level)


def read_3dgs_cameras(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (M, 3, 3) and positions (M, 3) of the cameras in the cameras.json that 3DGS writes for its model.

    M = 0 if there is no such file in the folder of the splats or above it, or if it is damaged.
    """
    for folder in list(path.absolute().parents)[:_MAX_SEARCHED_FOLDERS]:
        beside = folder / "cameras.json"
        try:
            if not beside.is_file() or beside.stat().st_size > MAX_JSON_BYTES:
                continue
            entries = json.loads(beside.read_bytes())
            rotations = np.array([camera["rotation"] for camera in entries], np.float64).reshape(-1, 3, 3)
            positions = np.array([camera["position"] for camera in entries], np.float64).reshape(-1, 3)
        except (OSError, ValueError, TypeError, KeyError, RecursionError):  # the points are drawn all the same
            break
        world_to_camera = rotations.transpose(0, 2, 1)  # the file has rotations from camera axes to model axes
        are_rotations = np.abs(world_to_camera @ rotations - np.eye(3)).max(initial=0) < 1e-3
        if len(world_to_camera) == len(positions) and are_rotations and np.isfinite(positions).all():
            return world_to_camera, positions
        break
    return np.empty((0, 3, 3)), np.empty((0, 3))
