"""Cameras on disk: viewpoints in JSON files, and in the records of pictures."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path

from z2p_core.interfaces import SettingError
from z2p_core.pinhole import PinholeCamera, camera_from_json
from z2p_core.placement.viewpoint import Viewpoint, viewpoint_from_json
from z2p_renderer.storage.files.atomic_write import atomic_write, file_kind
from z2p_renderer.storage.files.bounded_json import JsonError, read_json
from z2p_renderer.storage.files.printable_names import is_file, is_folder, path_exists, printable
from z2p_renderer.storage.images.image_files import FORMATS, PictureError, read_record
from z2p_renderer.storage.poses.colmap_poses import is_colmap_model
from z2p_renderer.storage.poses.nerfstudio_poses import is_transforms
from z2p_renderer.storage.poses.read_poses import LIST_KEY, MAX_POSE_BYTES, is_pinhole_json, read_poses

MAX_CAMERA_BYTES = 1 << 16
"""Camera files are smaller; larger files are not read."""


def check_camera_place(path: Path, taken: Iterable[Path] = ()) -> None:
    """Makes sure that a camera written to `path` would replace nothing but a camera.

    `taken` are the other files that the run reads or writes.

    Raises:
        SettingError: `path` is a folder, the name of a picture, one of `taken`, or an existing file that is no camera.
    """
    expected = f"--save-camera {printable(path)}: expected the name of a JSON file"
    if is_folder(path):
        raise SettingError(f"{expected}, got a folder; add a name, as {printable(path / 'camera.json')}")
    if path.suffix.lower() in (*FORMATS, ".gif"):
        raise SettingError(f"{expected}, got a picture's; each picture holds its camera anyway, see --load-camera")
    if any(_is_same_file(path, other) for other in taken):
        raise SettingError(f"{expected}, got a file that this run reads or writes; choose another")
    if path_exists(path) and not _is_camera(path):
        raise SettingError(f"{expected}, got a file that is there already and no camera of z2p; choose another")


def write_camera(viewpoint: Viewpoint, path: Path) -> None:
    """Writes a viewpoint as a JSON file, atomically."""
    atomic_write((json.dumps(viewpoint.to_json(), indent=2) + "\n").encode(), path)


def read_any_camera(path: Path) -> Viewpoint | PinholeCamera:
    """The viewpoint in a file, see `read_camera`, or the only camera in the data's units that it holds.

    Raises:
        SettingError: the file is missing, or holds neither; or it holds several cameras.
    """
    found = read_pinholes(path)
    if found is None:
        return read_camera(path)
    if len(found[0]) > 1:
        raise SettingError(
            f"cameras {printable(path)}: expected one camera, got {len(found[0])}; choose one of "
            "z2p_core.read_cameras(path)"
        )
    return found[0][0]


def read_pinholes(path: Path) -> tuple[list[PinholeCamera], str] | None:
    """The cameras in the data's units of a file, or of a picture's record, and a note on what was left out of them.

    None where the file is missing or holds a viewpoint, which `read_camera` reads.

    Raises:
        SettingError: the file holds neither.
    """
    if path.suffix.lower() in (*FORMATS, ".gif"):
        try:
            pinhole = read_record(path).get("pinhole")
        except (PictureError, OSError):  # `read_camera` says so
            return None
        return None if pinhole is None else ([camera_from_json(pinhole)], "")
    return None if _is_viewpoint(path) else read_poses(path)


def read_camera(path: Path) -> Viewpoint:
    """The viewpoint in a JSON file that `write_camera` wrote, or in the record of a picture.

    Raises:
        SettingError: the file is missing, is no JSON, is a picture without a record, or holds no camera.
    """
    try:
        picture = path.suffix.lower() in (*FORMATS, ".gif")
        data = read_record(path)["camera"] if picture else read_json(_read_head(path), MAX_CAMERA_BYTES)
        return viewpoint_from_json(data)
    except OSError as error:
        reason = error.strerror or error
        raise SettingError(f"camera {printable(path)}: {reason}; write one with --save-camera") from error
    except KeyError:
        raise SettingError(f"camera {printable(path)}: the picture's record holds none; write one with --save-camera"
                           ) from None
    except JsonError as error:
        raise SettingError(f"camera {printable(path)}: {error}; write one with --save-camera") from error
    except (PictureError, SettingError) as error:
        raise SettingError(f"camera {printable(path)}: {str(error).removeprefix(f'{printable(path)}: ')}") from error


def _read_head(path: Path) -> bytes:
    """The first bytes of a file, enough for a camera; something other than a file, as a pipe, is not read.

    Raises:
        OSError: there is no such file.
        SettingError: the path is that of something other than a file, or cannot be one.
    """
    if path_exists(path) and not is_file(path):
        raise SettingError(f"expected a JSON file or a picture, got {file_kind(path)}")
    try:
        with path.open("rb") as file:
            return file.read(MAX_CAMERA_BYTES + 1)
    except ValueError as error:  # a zero byte in its name
        raise SettingError(f"no such file ({error}); write one with --save-camera") from error


def _is_same_file(path: Path, other: Path) -> bool:
    """Whether two paths lead to the same file, whether or not it exists."""
    return os.path.realpath(path) == os.path.realpath(other) or (
        path_exists(path) and path_exists(other) and path.samefile(other)
    )


def _is_viewpoint(path: Path) -> bool:
    """Whether a file is missing, so that `read_camera` says so, or holds a viewpoint; COLMAP's files are none."""
    if is_colmap_model(path) or path.is_dir():
        return False
    try:
        with path.open("rb") as file:
            head = file.read(MAX_CAMERA_BYTES + 1)
        data = read_json(head, MAX_CAMERA_BYTES)
    except (OSError, ValueError):  # a long list of cameras, say
        return not path.is_file() or path.stat().st_size <= MAX_CAMERA_BYTES
    has_list = isinstance(data, list) or (isinstance(data, dict) and LIST_KEY in data)
    return not (has_list or is_transforms(data) or is_pinhole_json(data))


def _is_camera(path: Path) -> bool:
    """Whether a file is one that --save-camera wrote, which another may replace."""
    try:
        if not path.is_file() or path.stat().st_size > MAX_POSE_BYTES:
            return False
        data = read_json(path.read_bytes(), MAX_POSE_BYTES)
        return "z2p_camera" in data or all("z2p_pinhole" in one for one in (data if isinstance(data, list) else [data]))
    except (OSError, ValueError, TypeError):
        return False
