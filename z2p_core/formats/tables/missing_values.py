"""No-data values: numbers such as -9999 and 1e30 that programs write in place of missing measurements."""

from __future__ import annotations

import numpy as np

from z2p_core.linalg import bounding_box

NODATA_VALUES = (-999.0, -9999.0, -99999.0, -999999.0, 9999.0, 99999.0, 999999.0, -32768.0, -32767.0, 32767.0,
                 -2147483648.0)  # fmt: skip
_MIN_NODATA_MAGNITUDE = 1e20
"""Numbers of this magnitude or more are no coordinates; several raster and mesh formats write them for no data."""
_MIN_GAP_EXTENTS = 2.0
"""A no-data value lies at least this far from all other numbers of its axis, in multiples of their extent."""
_MIN_MEASURED_POINTS = 3
"""An axis has no-data values only beside at least this many other numbers."""


def measured_mask(points: np.ndarray) -> np.ndarray | None:
    """Mask (N,) bool of finite points (N, 3), False for those with a no-data value; None if no point has one.

    A number is a no-data value if it is a usual one and lies far from all other numbers of its axis.
    """
    kept: np.ndarray | None = None
    lows, highs = bounding_box(points)
    for axis in range(3):
        column = points[:, axis]
        for value in _candidates(float(lows[axis]), float(highs[axis])):
            missing = np.abs(column) >= _MIN_NODATA_MAGNITUDE if value is None else column == value
            others = column[~missing]
            if len(others) < _MIN_MEASURED_POINTS:
                continue
            low, high = float(others.min()), float(others.max())
            if value is not None and _MIN_GAP_EXTENTS * (high - low) > min(abs(value - low), abs(value - high)):
                continue
            kept = ~missing if kept is None else kept & ~missing
    return kept


def _candidates(low: float, high: float) -> list[float | None]:
    """The usual no-data values that are the minimum or maximum of a column; None stands for all huge numbers."""
    values: list[float | None] = [value for value in NODATA_VALUES if value in (low, high)]
    return [None, *values] if max(abs(low), abs(high)) >= _MIN_NODATA_MAGNITUDE else values
