"""Column layouts of raw lidar sweeps (KITTI, nuScenes), which are float32 rows without a header."""

from __future__ import annotations

import numpy as np

KITTI_COLUMNS = ("x", "y", "z", "intensity")
NUSCENES_COLUMNS = (*KITTI_COLUMNS, "ring")
"""nuScenes adds the index of the laser beam."""
_MAX_RANGE_METRES, _MAX_INTENSITY = 2000.0, 65535.0
"""Largest range and intensity that a lidar reports."""


def is_plausible_sweep(rows: np.ndarray) -> bool:
    """Whether rows (N, 4 or more) float32 have the ranges, intensities and finite values of a lidar sweep."""
    with np.errstate(invalid="ignore"):
        near = np.abs(rows[:, :3]) <= _MAX_RANGE_METRES
        lit = (rows[:, 3] >= 0) & (rows[:, 3] <= _MAX_INTENSITY)
    denormal = (rows != 0) & (np.abs(rows) < np.finfo(np.float32).tiny)  # small integers, read as float32, are denormal
    return bool(near.all() and lit.all() and not denormal.any())
