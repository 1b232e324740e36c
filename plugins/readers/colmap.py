"""Models of COLMAP: the points of points3D.bin, and what the cameras beside them tell of up and of a good view."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np

from z2p_core.colmap_model import counts_points, is_points
from z2p_core.interfaces import RawCloud, ScanError
from z2p_core.native import walk_rows

AXES_REASON = "the usual axes of COLMAP"
_POINT = [(np.dtype(kind), None) for kind in ("<u8", "<f8", "<f8", "<f8", "u1", "u1", "u1", "<f8")]
_TRACK = (np.dtype("<u8"), np.dtype("<u8"))
"""A point's id, place, colour and error; then the pictures that show it, as pairs of numbers of four bytes."""
_LONGEST_NAME = 4096
_NEAR, _ALIKE = 20.0, 0.5
"""Degrees between the cameras' up and an axis that it may be; and the least length of the mean of their unit vectors,
for cameras that were held in all ways say nothing."""
_TURNED = 0.2
"""How far cameras must be turned to one another to tell what was level to all of them."""


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
        points, end = walk_rows(blob, 8, count, [*_POINT, _TRACK], [1, 2, 3])
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
    poses = _poses(path.parent)
    if not len(poses):
        return cloud
    places = -np.einsum("nij,ni->nj", poses[:, :, :3], poses[:, :, 3])
    seen_from = places[((places - places.mean(0)) ** 2).sum(1).argmin()]
    upward = _upward(poses[:, :, :3])
    if upward is None:
        return replace(cloud, seen_from=seen_from)
    longest = int(np.abs(upward).argmax())
    axis = ("+" if upward[longest] > 0 else "-") + "XYZ"[longest]
    tilted = abs(float(upward[longest])) < np.cos(np.radians(_NEAR))
    return replace(cloud, up=axis, up_certain=True, up_reason=f"its {len(poses)} cameras stood so",
                   upward=upward if tilted else None, seen_from=seen_from)  # fmt: skip


def _upward(rotations: np.ndarray) -> np.ndarray | None:
    """The unit vector (3,) that was up to cameras of rotations (M, 3, 3); None where they were held in all ways.

    Their own up leans back where they look down, and is no more than the direction; what is at right angles to what was
    right to all of them is up, unless they all look the same way.
    """
    mean = -rotations[:, 1].mean(0)
    length = float(np.linalg.norm(mean))
    if length < _ALIKE:
        return None
    spread, axes = np.linalg.svd(rotations[:, 0], full_matrices=True)[1:]
    level = axes[2]
    if len(rotations) < 3 or spread[1] < _TURNED * len(rotations) ** 0.5 or abs(level @ mean) < _ALIKE * length:
        return np.asarray(mean / length)
    return np.asarray(level if level @ mean > 0 else -level)


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
    w, x, y, z = (numbers[fine, :4] / length[fine, None]).T
    rotation = np.stack([
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], -1),
        np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], -1),
        np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], -1),
    ], 1)  # fmt: skip
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
