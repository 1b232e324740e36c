"""Up axis and viewpoint of a cloud from the camera files beside it: those of COLMAP, nerfstudio and 3DGS."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from z2p_core.interfaces import RawCloud
from z2p_core.up_axis.header_comments import axis_of_vector
from z2p_renderer.plugins.readers._cameras.camera_hints import MAX_JSON_BYTES, read_3dgs_cameras, with_camera_hints
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily

_MAX_IMAGES_FILE_BYTES = 1 << 28
"""Larger lists of images are not read."""
_IMAGES_NAMES = ("images.bin", "images.txt")
_DENSE_NAMES = ("fused.ply", "meshed-poisson.ply", "meshed-delaunay.ply")
"""Names of COLMAP's dense results; the model that they were made from lies in the folder ``sparse`` beside them."""
_INPUT_NAME = "input.ply"
"""Name of the copy that 3DGS keeps of its initial points."""
_OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0])
"""Rotation from the camera axes of nerfstudio to those of OpenCV."""
_ORTHOGONAL_TOLERANCE = 1e-2
"""Largest deviation of R^T R from the identity, for a matrix R that counts as a rotation."""


def with_model_cameras(cloud: RawCloud, path: Path) -> RawCloud:
    """Returns the cloud of a file with the up axis and the viewpoint of the cameras beside it.

    Cameras that may belong to another cloud only suggest an axis. Without cameras the cloud is returned as it is;
    damaged camera files are ignored.
    """
    name = path.name.lower()
    if name == _INPUT_NAME:
        return with_camera_hints(cloud, *read_3dgs_cameras(path))
    folder = path.parent / "sparse" if name in _DENSE_NAMES else path.parent
    if any(_is_file_within(folder / images, _MAX_IMAGES_FILE_BYTES) for images in _IMAGES_NAMES):
        colmap = import_lazily("z2p_renderer.plugins.readers._cameras.colmap")
        rotations, positions = colmap.read_colmap_cameras(folder)
        if len(positions):
            return with_camera_hints(_with_usual_up(cloud, "-Y", colmap.AXES_REASON), rotations, positions)
    if name in _DENSE_NAMES:
        return _with_usual_up(cloud, "-Y", "the usual axes of COLMAP, as whose result it is named")
    if _is_file_within(path.parent / "transforms.json", MAX_JSON_BYTES):
        return _with_nerfstudio_cameras(cloud, path)
    return cloud


def _with_usual_up(cloud: RawCloud, axis: str, reason: str) -> RawCloud:
    return replace(cloud, up=axis, up_reason=reason, up_certain=False)


def _is_file_within(path: Path, max_bytes: int) -> bool:
    try:
        return path.is_file() and path.stat().st_size <= max_bytes
    except OSError:
        return False


def _with_nerfstudio_cameras(cloud: RawCloud, path: Path) -> RawCloud:
    """The cloud with the up axis and viewpoint of the cameras in the transforms.json beside it.

    They are certain if the file names this cloud. Any other cloud may have been rotated since, so for it the cameras
    only suggest an axis.
    """
    try:
        transforms = json.loads((path.parent / "transforms.json").read_bytes())
    except (OSError, ValueError, RecursionError):
        return cloud
    if not isinstance(transforms, dict) or not isinstance(transforms.get("frames"), list):
        return cloud
    rotations, positions = _parse_frames(transforms["frames"])
    usual_reason = "the usual axes of nerfstudio, whose transforms.json lies beside it"
    cloud = _with_usual_up(cloud, _world_up_axis(transforms), usual_reason)
    hinted = with_camera_hints(cloud, rotations, positions)
    ply_name = transforms.get("ply_file_path")
    if isinstance(ply_name, str) and PurePath(ply_name).name == path.name:
        return hinted
    reason = hinted.up_reason if not hinted.up_certain else "that of the cameras in the transforms.json beside it"
    return _with_usual_up(cloud, hinted.up, reason)


def _parse_frames(frames: list[Any]) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (M, 3, 3) from world axes to the OpenCV axes of each camera, and camera positions (M, 3).

    M = 0 if a frame has no valid pose matrix.
    """
    none = np.empty((0, 3, 3)), np.empty((0, 3))
    try:
        poses = np.array([frame["transform_matrix"] for frame in frames], np.float64)
    except (ValueError, TypeError, KeyError):
        return none
    if poses.ndim != 3 or poses.shape[1] not in (3, 4) or poses.shape[2] != 4 or not np.isfinite(poses).all():
        return none
    axes = poses[:, :3, :3] / np.maximum(np.linalg.norm(poses[:, :3, :3], axis=1, keepdims=True), 1e-12)
    if np.abs(axes.transpose(0, 2, 1) @ axes - np.eye(3)).max(initial=0) > _ORTHOGONAL_TOLERANCE:
        return none
    return _OPENGL_TO_OPENCV @ axes.transpose(0, 2, 1), poses[:, :3, 3]


def _world_up_axis(transforms: dict[str, Any]) -> str:
    """The up axis of nerfstudio's world: +Z, or the image of COLMAP's -Y if the file has the applied transform."""
    try:
        up = np.array(transforms["applied_transform"], np.float64)[:3, :3] @ [0.0, -1.0, 0.0]
        return axis_of_vector([round(number, 6) for number in up.tolist()]) or "+Z"
    except (KeyError, ValueError, TypeError, IndexError):
        return "+Z"
