"""What the cameras that a cloud was made from tell of it: which way is up, and from where people looked at it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from z2p_core.interfaces import RawCloud

_MAX_AXIS_TILT_DEGREES, _MIN_MEAN_UP_LENGTH = 20.0, 0.5
"""Degrees between the cameras' up and an axis that it may be; and the least length of the mean of their unit vectors,
for cameras that were held in all ways say nothing."""
_MIN_RIGHT_SPREAD = 0.2
"""How far cameras must be turned to one another to tell what was level to all of them."""
MAX_JSON_BYTES, _MAX_SEARCHED_FOLDERS = 1 << 26, 3
"""Bytes of a list of cameras at the most, and folders in which it is looked for, from that of the points upwards."""


def with_camera_hints(cloud: RawCloud, rotations: np.ndarray, places: np.ndarray) -> RawCloud:
    """The cloud with up and view as its cameras had them; as it is where there are none.

    `rotations` (M, 3, 3) go from the cloud's axes to each camera's, those of OpenCV; `places` (M, 3) are the cameras'.
    """
    if not len(places):
        return cloud
    seen_from = places[((places - places.mean(0)) ** 2).sum(1).argmin()]
    upward = _estimate_up(rotations)
    if upward is None:
        return replace(cloud, seen_from=seen_from)
    longest = int(np.abs(upward).argmax())
    axis = ("+" if upward[longest] > 0 else "-") + "XYZ"[longest]
    tilted = abs(float(upward[longest])) < np.cos(np.radians(_MAX_AXIS_TILT_DEGREES))
    return replace(cloud, up=axis, up_certain=True, up_reason=f"its {len(places)} cameras stood so",
                   upward=upward if tilted else None, seen_from=seen_from)  # fmt: skip


def _estimate_up(rotations: np.ndarray) -> np.ndarray | None:
    """The unit vector (3,) that was up to cameras of rotations (M, 3, 3); None where they were held in all ways.

    Their own up leans back where they look down, and is no more than the direction; what is at right angles to what was
    right to all of them is up, unless they all look the same way.
    """
    mean = -rotations[:, 1].mean(0)
    length = float(np.linalg.norm(mean))
    if length < _MIN_MEAN_UP_LENGTH:
        return None
    spread, axes = np.linalg.svd(rotations[:, 0], full_matrices=True)[1:]
    level = axes[2]
    min_spread, off = _MIN_RIGHT_SPREAD * len(rotations) ** 0.5, abs(level @ mean) < _MIN_MEAN_UP_LENGTH * length
    if len(rotations) < 3 or spread[1] < min_spread or off:
        return np.asarray(mean / length)
    return np.asarray(level if level @ mean > 0 else -level)


def read_3dgs_cameras(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (M, 3, 3) and places (M, 3) of the cameras in the cameras.json that 3DGS writes for its model.

    None where there is no such file in the folder of the splats or above it, or where it is damaged.
    """
    for folder in list(path.absolute().parents)[:_MAX_SEARCHED_FOLDERS]:
        beside = folder / "cameras.json"
        try:
            if not beside.is_file() or beside.stat().st_size > MAX_JSON_BYTES:
                continue
            listed = json.loads(beside.read_bytes())
            rotations = np.array([camera["rotation"] for camera in listed], np.float64).reshape(-1, 3, 3)
            places = np.array([camera["position"] for camera in listed], np.float64).reshape(-1, 3)
        except (OSError, ValueError, TypeError, KeyError, RecursionError):  # the points are drawn all the same
            break
        turned = rotations.transpose(0, 2, 1)  # from the camera's axes to the model's is how they stand in the file
        square = np.abs(turned @ rotations - np.eye(3)).max(initial=0) < 1e-3
        if len(turned) == len(places) and square and np.isfinite(places).all():
            return turned, places
        break
    return np.empty((0, 3, 3)), np.empty((0, 3))
