"""Reads files of cameras in the data's units, whatever program wrote them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from z2p_core.interfaces import SettingError
from z2p_core.pinhole import PinholeCamera, camera_from_json
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.files.bounded_json import JsonError, read_json
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.poses.colmap_poses import is_colmap_model, read_colmap_poses
from z2p_renderer.storage.poses.nerfstudio_poses import is_transforms, parse_transforms

MAX_POSE_BYTES = 1 << 26
"""Larger files of poses are not read: this holds some 50,000 cameras."""
EXPECTED = (
    "expected a camera as JSON (K, R, t, width, height), a list of them, a transforms.json of nerfstudio, or a "
    "COLMAP model (its folder, or cameras.txt beside images.txt)"
)
LIST_KEY = "cameras"
"""Key under which a JSON object may hold a list of cameras."""


def read_poses(path: Path) -> tuple[list[PinholeCamera], str]:
    """The cameras of a file or a COLMAP folder, at least one, and what was left out of them, in words.

    Raises:
        SettingError: the file is missing, or holds no cameras; the message names it.
    """
    try:
        if is_colmap_model(path):
            cameras, note = read_colmap_poses(path)
        elif path.is_dir():
            cameras, note = _parse_json(_read_json(path / "transforms.json"))
        else:
            cameras, note = _parse_json(_read_json(path))
        if not cameras:
            raise SettingError("expected cameras, got an empty list")
    except OSError as error:
        raise SettingError(f"cameras {printable(path)}: {error.strerror or error}; {EXPECTED}") from error
    except (SettingError, JsonError) as error:
        raise SettingError(f"cameras {printable(path)}: {str(error).removeprefix('camera: ')}") from error
    return cameras, note


def write_poses(cameras: Sequence[PinholeCamera], path: Path) -> None:
    """Writes one camera as a JSON object, or several as a list, atomically."""
    data: Any = [camera.to_json() for camera in cameras] if len(cameras) != 1 else cameras[0].to_json()
    atomic_write((json.dumps(data, indent=2) + "\n").encode(), path)


def is_pinhole_json(data: Any) -> bool:
    """Whether JSON data holds a camera with K, R and t, rather than a viewpoint of z2p."""
    return isinstance(data, Mapping) and "K" in data


def _read_json(path: Path) -> Any:
    with path.open("rb") as file:
        return read_json(file.read(MAX_POSE_BYTES + 1), MAX_POSE_BYTES)


def _parse_json(data: Any) -> tuple[list[PinholeCamera], str]:
    if is_transforms(data):
        return parse_transforms(data)
    if isinstance(data, Mapping) and isinstance(data.get(LIST_KEY), list):
        data = data[LIST_KEY]
    if not isinstance(data, list):
        if not is_pinhole_json(data):
            raise SettingError(EXPECTED)
        return [camera_from_json(data)], ""
    cameras = []
    for number, one in enumerate(data):
        try:
            cameras.append(camera_from_json(one))
        except SettingError as error:
            raise SettingError(f"camera {number}: {str(error).removeprefix('camera: ')}") from error
    return cameras, ""
