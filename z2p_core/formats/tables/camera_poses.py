"""Recognizes camera trajectories and camera matrices, which data sets keep beside their clouds."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

_ROTATION_TOLERANCE = 0.01
"""Largest deviation of R R^T from the identity, and of a quaternion's squared length from 1."""
_MIN_QUATERNION_ROWS = 2
"""Least number of rows in a list of positions with quaternions; a single row could be anything."""
_QUATERNION_PREFIXES = ("q", "q_", "quat_", "orientation_", "orientation.", "rot_q", "rotation_")
"""Prefixes of w, x, y and z in the names of a quaternion's columns."""


@np.errstate(all="ignore")  # the numbers may be no coordinates
def pose_kind(table: np.ndarray) -> str:
    """Description of a table (N, M) that is a list of poses or a camera matrix; empty for any other table."""
    if table.ndim != 2 or not len(table) or not np.isfinite(table).all():
        return ""
    width = table.shape[1]
    if width in (12, 16) and _are_poses(table.reshape(len(table), -1, 4)[:, :3]):
        return "a list of poses, a matrix of 12 or 16 numbers a row, as KITTI keeps a camera's way"
    if width in (13, 17) and _are_poses(table[:, 1:].reshape(len(table), -1, 4)[:, :3]):
        return "a list of poses, an index and a matrix of 12 or 16 numbers a row"
    if len(table) in (3, 4) and width == 4 and _are_poses(table[None, :3]) and _ends_as_homogeneous(table):
        return "a camera's pose, one matrix"
    if len(table) in (3, 4) and width == len(table) and _is_intrinsics(table):
        return "a camera's matrix of intrinsics"
    if table.shape == (3, 3) and _are_poses(np.column_stack([table, np.zeros(3)])[None]):
        return "a camera's rotation, one matrix"
    if len(table) >= _MIN_QUATERNION_ROWS and _are_quaternions(table):
        return "a list of poses, as TUM's: time, position and quaternion"
    return ""


def are_pose_names(names: Collection[str]) -> bool:
    """Whether columns with these names, lower-case, hold poses: a quaternion for each position."""
    return any({f"{before}{axis}" for axis in "wxyz"} <= set(names) for before in _QUATERNION_PREFIXES)


def _are_poses(matrices: np.ndarray) -> bool:
    """Whether all matrices (N, 3, 4) are a rotation and a translation."""
    turns = matrices[:, :, :3]
    products = turns @ turns.swapaxes(1, 2)
    return bool((np.abs(products - np.eye(3)) < _ROTATION_TOLERANCE).all() and (np.linalg.det(turns) > 0).all())


def _ends_as_homogeneous(table: np.ndarray) -> bool:
    return len(table) == 3 or bool(np.array_equal(table[3], [0, 0, 0, 1]))


def _is_intrinsics(table: np.ndarray) -> bool:
    """Whether a matrix (3, 3) or (4, 4) holds focal lengths and a principal point in pixels."""
    below = np.array_equal(np.tril(table, -1), np.zeros_like(table))
    return bool(below and table[2, 2] == 1 and table[-1, -1] == 1 and table[0, 0] > 1 and table[1, 1] > 1)


def _are_quaternions(table: np.ndarray) -> bool:
    """Whether columns hold positions and unit quaternions: columns 2 to 8 behind an increasing time, or 1 to 7."""
    width = table.shape[1]
    starts = [4] if width >= 8 and bool((np.diff(table[:, 0]) > 0).all()) else []
    starts += [3] if width == 7 else []
    return any(bool((np.abs((table[:, at : at + 4] ** 2).sum(1) - 1) < _ROTATION_TOLERANCE).all()) for at in starts)
