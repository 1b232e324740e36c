"""Rows of float32 without a header, as KITTI and nuScenes keep lidar sweeps: what tells them from other files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

USUAL = ("x", "y", "z", "intensity")
WITH_RING = (*USUAL, "ring")
"""nuScenes adds which of the lidar's beams it was."""
_FARTHEST, _BRIGHTEST = 2000.0, 65535.0
"""Metres that a lidar sees at the most, and the largest intensity that one writes."""


def usual_columns(path: Path, size: int) -> tuple[str, ...]:
    """Columns that nobody names, told by the file's name and its size in bytes."""
    if path.name.lower().endswith(".pcd.bin"):
        return WITH_RING
    return WITH_RING if size % (4 * len(USUAL)) and not size % (4 * len(WITH_RING)) else USUAL


def could_be_measured(rows: np.ndarray) -> bool:
    """Whether rows (N, 4 or more) float32 could be a lidar's: near, finite, and as bright as numbers from 0 on."""
    with np.errstate(invalid="ignore"):
        near = np.abs(rows[:, :3]) <= _FARTHEST
        lit = (rows[:, 3] >= 0) & (rows[:, 3] <= _BRIGHTEST)
    denormal = (rows != 0) & (np.abs(rows) < np.finfo(np.float32).tiny)  # what small integers look like as float32
    return bool(near.all() and lit.all() and not denormal.any())
