"""Places a cloud without choosing up, view or outliers: what tests of the renderer need."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import DEFAULT_ELEVATION, turn
from z2p_core.placement.viewpoint import frame_points
from z2p_core.up_axis.axis_names import UP_ROTATIONS


def place_cloud(points: np.ndarray, up: str | np.ndarray = "+Z", azimuth: float = 0.0) -> np.ndarray:
    """Cloud (N, 3) float32 in world units: `up` turned to +Z, in the unit sphere, turned by `azimuth` degrees about Z.

    `points` (N, 3) float64 are finite, in any unit. `up` names an axis of the data, or is a rotation (3, 3).

    Raises:
        ScanError: there are no points, or all are in one place.
    """
    upright = np.asarray(UP_ROTATIONS[up] if isinstance(up, str) else up, dtype=np.float64)
    return frame_points(points, turn(azimuth) @ upright, DEFAULT_ELEVATION).place(points)
