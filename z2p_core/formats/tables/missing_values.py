"""Numbers that programs write where nothing was measured, and that are no coordinates: -9999, 1e30 and their like."""

from __future__ import annotations

import numpy as np

NODATA_VALUES = (-999.0, -9999.0, -99999.0, -999999.0, 9999.0, 99999.0, 999999.0, -32768.0, -32767.0, 32767.0,
                 -2147483648.0)  # fmt: skip
_LARGEST_COORDINATE = 1e20
"""No coordinate is as large; several formats of rasters and meshes write such numbers."""
_LEAST_EXTENTS_AWAY = 2.0
"""How many times the extent of all else such a number lies away from it."""
_FEWEST_MEASURED = 3
"""Other numbers of an axis, at least, beside which one can stand for none."""


def measured(points: np.ndarray) -> np.ndarray | None:
    """Mask (N,) bool of finite points (N, 3), False for those with a number that stands for none; None if all count.

    A number counts as such if it is a usual one and lies far from all others of its axis.
    """
    kept: np.ndarray | None = None
    for axis in range(3):
        column = points[:, axis]
        for mark in _candidates(column):
            found = np.abs(column) >= _LARGEST_COORDINATE if mark is None else column == mark
            others = column[~found]
            if len(others) < _FEWEST_MEASURED:
                continue
            low, high = float(others.min()), float(others.max())
            if mark is not None and _LEAST_EXTENTS_AWAY * (high - low) > min(abs(mark - low), abs(mark - high)):
                continue
            kept = ~found if kept is None else kept & ~found
    return kept


def _candidates(column: np.ndarray) -> list[float | None]:
    """Usual numbers that are the column's least or largest one; None stands for all that are absurdly large."""
    low, high = float(column.min()), float(column.max())
    marks: list[float | None] = [mark for mark in NODATA_VALUES if mark in (low, high)]
    return [None, *marks] if max(abs(low), abs(high)) >= _LARGEST_COORDINATE else marks
