"""Reads COLMAP models: the points of points3D.bin, and the poses of the cameras beside them."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np

from z2p_core.formats.colmap_files import is_colmap_points, is_colmap_points_head
from z2p_core.interfaces import RawCloud, ScanError
from z2p_core.native import read_list_rows
from z2p_core.rotations import quaternion_rotations
from z2p_renderer.plugins.readers._cameras.camera_hints import with_camera_hints
from z2p_renderer.plugins.readers._helpers.point_fields import Wants, plan_fields, whole_if_whole

AXES_REASON = "the usual axes of COLMAP"
_POINT_FIELDS = [(np.dtype(kind), None) for kind in ("<u8", "<f8", "<f8", "<f8", "u1", "u1", "u1", "<f8")]
_POINT_NAMES = ("point3d_id", "x", "y", "z", "r", "g", "b", "error", "track_length")
_TRACK_OFFSET = 43
"""Bytes of a point before the length of its track."""
_TRACK_FIELD = (np.dtype("<u8"), np.dtype("<u8"))
"""A point's id, position, color and error; then its track, pairs of four-byte image and feature indices."""
_MAX_NAME_BYTES = 4096
"""Longest name of an image that is read from an images.bin."""
_MIN_IMAGE_BYTES, _FEATURE_BYTES = 73, 24
"""Size of an image in an images.bin with an empty name and no features, and size of each feature."""


def is_points3d(path: Path) -> bool:
    """Whether a file holds the points of a COLMAP model, by its name or by the count at its beginning."""
    with path.open("rb") as file:
        return is_colmap_points(path) or is_colmap_points_head(file.read(8), path.stat().st_size)


def read_points3d(path: Path, wants: Wants) -> RawCloud:
    """Reads a points3D.bin, with the up axis and viewpoint from the cameras beside it.

    Raises:
        ScanError: the file is shorter or longer than its point count requires.
    """
    blob = path.read_bytes()
    if not blob:
        return RawCloud(np.empty((0, 3)))
    (count,) = struct.unpack("<Q", blob[:8].ljust(8, b"\0"))
    try:
        plan = plan_fields(_POINT_NAMES, wants, (1, 2, 3))
        wanted = [1, 2, 3, *(column for column in plan.columns if column < len(_POINT_FIELDS))]
        table, end = read_list_rows(blob, 8, count, [*_POINT_FIELDS, _TRACK_FIELD], wanted)
    except ValueError as error:
        raise ScanError(f"COLMAP's points promise to be {count}, and the file ends before; copy it again") from error
    if end != len(blob):
        raise ScanError(f"COLMAP's {count} points end at byte {end}, but the file has {len(blob)}; copy it again")
    columns = {column: whole_if_whole(table[:, index]) for index, column in enumerate(wanted) if index >= 3}
    if "track_length" in plan.needed:
        columns[len(_POINT_FIELDS)] = _track_lengths(blob, count)
    cloud = with_colmap_cameras(np.ascontiguousarray(table[:, :3]), path)
    return replace(plan.fill(cloud, columns), units={"error": "px"})


def _track_lengths(blob: bytes, count: int) -> np.ndarray:
    """The number of images (count,) that see each point of a points3D.bin."""
    lengths, at = np.empty(count, np.int32), 8 + _TRACK_OFFSET
    for row in range(count):
        (lengths[row],) = struct.unpack_from("<Q", blob, at)
        at += _TRACK_OFFSET + 8 + 8 * int(lengths[row])
    return lengths


def with_colmap_cameras(points: np.ndarray, path: Path, note: str = "") -> RawCloud:
    """The points (N, 3) of the model file `path`, with the up axis and viewpoint from the cameras in its folder.

    Without cameras, up is -Y: most models keep the axes of their first image.
    """
    cloud = RawCloud(points, note=note, up="-Y", up_reason=AXES_REASON, up_certain=False)
    return with_camera_hints(cloud, *read_colmap_cameras(path.parent))


def read_colmap_cameras(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (M, 3, 3) from model to camera axes, and camera positions (M, 3); M = 0 without a model."""
    poses = _read_poses(folder)
    return poses[:, :, :3], -np.einsum("nij,ni->nj", poses[:, :, :3], poses[:, :, 3])


def _read_poses(folder: Path) -> np.ndarray:
    """World-to-camera matrices (M, 3, 4) of a model's images; M = 0 if they cannot be read."""
    poses = []
    for name, read in (("images.bin", _read_images_bin), ("images.txt", _read_images_txt)):
        try:
            poses = read(folder / name)
        except (OSError, ValueError, struct.error):  # missing or damaged: the points are drawn without cameras
            continue
        if poses:
            break
    numbers = np.array(poses, dtype=np.float64).reshape(-1, 7)
    length = np.linalg.norm(numbers[:, :4], axis=1)
    valid = np.isfinite(numbers).all(1) & (length > 0)
    rotation = quaternion_rotations(numbers[valid, :4] / length[valid, None])
    return np.concatenate([rotation, numbers[valid, 4:, None]], axis=2)


def _read_images_bin(path: Path) -> list[list[float]]:
    """Quaternion (w, x, y, z) and translation of each image in an images.bin."""
    blob = path.read_bytes()
    (count,) = struct.unpack_from("<Q", blob)
    poses, at = [], 8
    for _ in range(min(count, len(blob) // _MIN_IMAGE_BYTES)):
        poses.append(list(struct.unpack_from("<7d", blob, at + 4)))
        at = blob.index(b"\0", at + 64, at + 64 + _MAX_NAME_BYTES) + 1
        (features,) = struct.unpack_from("<Q", blob, at)
        at += 8 + _FEATURE_BYTES * features
    return poses


def _read_images_txt(path: Path) -> list[list[float]]:
    """The same for an images.txt, which has a second line of features for each image."""
    poses, pose_next = [], True
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            if line.startswith("#"):
                continue
            if pose_next and len(words := line.split()) >= 10:
                poses.append([float(word) for word in words[1:8]])
                pose_next = False
            else:
                pose_next = True
    return poses
