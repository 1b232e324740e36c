"""Models of COLMAP: the points of points3D.bin, and what the cameras beside them tell of up and of a good view."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from z2p_core.formats.colmap_files import counts_points, is_points
from z2p_core.interfaces import RawCloud, ScanError
from z2p_core.native import read_list_rows
from z2p_core.rotations import quaternion_rotations
from z2p_renderer.plugins.readers._cameras.camera_hints import with_camera_hints

AXES_REASON = "the usual axes of COLMAP"
_POINT = [(np.dtype(kind), None) for kind in ("<u8", "<f8", "<f8", "<f8", "u1", "u1", "u1", "<f8")]
_TRACK = (np.dtype("<u8"), np.dtype("<u8"))
"""A point's id, place, colour and error; then the pictures that show it, as pairs of numbers of four bytes."""
_LONGEST_NAME = 4096


def is_points3d(path: Path) -> bool:
    """Whether a file is a model's points: what it counts first are so many points, of the size of such."""
    with path.open("rb") as file:
        return is_points(path) or counts_points(file.read(8), path.stat().st_size)


def read_points3d(path: Path) -> RawCloud:
    """The points of a points3D.bin, with what cameras beside it tell.

    Raises:
        ScanError: the file is cut short, or longer than the points that it counts.
    """
    blob = path.read_bytes()
    if not blob:
        return RawCloud(np.empty((0, 3)))
    (count,) = struct.unpack("<Q", blob[:8].ljust(8, b"\0"))
    try:
        points, end = read_list_rows(blob, 8, count, [*_POINT, _TRACK], [1, 2, 3])
    except ValueError as error:
        raise ScanError(f"COLMAP's points promise to be {count}, and the file ends before; copy it again") from error
    if end != len(blob):
        raise ScanError(f"COLMAP's {count} points end at byte {end}, but the file has {len(blob)}; copy it again")
    return posed(points, path)


def posed(points: np.ndarray, path: Path, note: str = "") -> RawCloud:
    """A model's points (N, 3), of the file `path`, with the up and the view of the cameras in its folder.

    Where there are none, up is -Y: so are the axes of the first picture, of which most models keep the others.
    """
    cloud = RawCloud(points, note=note, up="-Y", up_reason=AXES_REASON, up_certain=False)
    return with_camera_hints(cloud, *cameras_in(path.parent))


def cameras_in(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (M, 3, 3) from a model's axes to each camera's, and their places (M, 3); none without a model."""
    poses = _poses(folder)
    return poses[:, :, :3], -np.einsum("nij,ni->nj", poses[:, :, :3], poses[:, :, 3])


def _poses(folder: Path) -> np.ndarray:
    """Where a model's pictures were taken: matrices (M, 3, 4) from its axes to each camera's; none if nothing tells."""
    poses = []
    for name, read in (("images.bin", _binary), ("images.txt", _text)):
        try:
            poses = read(folder / name)
        except (OSError, ValueError, struct.error):  # not there, or damaged: the points are drawn all the same
            continue
        if poses:
            break
    numbers = np.array(poses, dtype=np.float64).reshape(-1, 7)
    length = np.linalg.norm(numbers[:, :4], axis=1)
    fine = np.isfinite(numbers).all(1) & (length > 0)
    rotation = quaternion_rotations(numbers[fine, :4] / length[fine, None])
    return np.concatenate([rotation, numbers[fine, 4:, None]], axis=2)


def _binary(path: Path) -> list[list[float]]:
    """Quaternion (w, x, y, z) and shift of each picture in an images.bin."""
    blob = path.read_bytes()
    (count,) = struct.unpack_from("<Q", blob)
    poses, at = [], 8
    for _ in range(min(count, len(blob) // 73)):
        poses.append(list(struct.unpack_from("<7d", blob, at + 4)))
        at = blob.index(b"\0", at + 64, at + 64 + _LONGEST_NAME) + 1
        (marks,) = struct.unpack_from("<Q", blob, at)
        at += 8 + 24 * marks
    return poses


def _text(path: Path) -> list[list[float]]:
    """The same of an images.txt, in which a second line of each picture holds what it shows."""
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
