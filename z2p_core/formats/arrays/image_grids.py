"""Recognizes arrays that are images (depth maps, height grids, color images) rather than rows of points."""

from __future__ import annotations

import numpy as np

MIN_GRID_COLUMNS = 7
"""Arrays (N, C) with fewer columns are never images: points have up to six columns."""
_WIDE_GRID_COLUMNS, _MAX_ROWS_PER_COLUMN = 17, 4
"""An array with at least the first number of columns is an image unless it has more rows per column than the second."""
_MIN_CORRELATION, _MIN_CORRELATED_SHARE = 0.8, 0.7
"""Correlation of neighboring columns in an image, and the share of the columns that must reach it."""
_MAX_SAMPLED_ROWS = 2000
"""Rows of an array that are examined."""
_MAX_SAMPLED_SIDE, _GRAY_STEP_TOLERANCE, _MIN_SHADES = 64, 0.02, 16
"""Rows and columns of a color image that are examined, in pixels; how far values may be from multiples of 1/255, in
these; and how many different values an image has at least."""
GRID_ADVICE = ("a depth map becomes points by its camera: save it as depth, and the camera's matrix as K, in one npz, "
               "or save x = (column - cx) * depth / fx, y = (row - cy) * depth / fy and z = depth; a grid of heights "
               "becomes points by the places of its columns and rows")


@np.errstate(all="ignore")  # the numbers may be no coordinates
def is_grid(table: np.ndarray, total: int | None = None) -> bool:
    """Whether numbers (H, W) are an image: neighboring columns are correlated, unlike those of points.

    Arrays with many columns and few rows count as images, too, and so do unsigned integers of 8 or 16 bits. `total` is
    the number of rows if `table` has only the first of them.
    """
    rows, width = table.shape
    if width < MIN_GRID_COLUMNS:
        return False
    if table.dtype.kind == "u" and table.dtype.itemsize <= 2:
        return True
    if width >= _WIDE_GRID_COLUMNS and max(rows, total or 0) <= _MAX_ROWS_PER_COLUMN * width:
        return True
    sample = table[:: max(-(-rows // _MAX_SAMPLED_ROWS), 1)].astype(np.float64)
    return rows >= MIN_GRID_COLUMNS and _are_neighbors_correlated(sample)


@np.errstate(all="ignore")  # the numbers may be no coordinates
def is_picture(array: np.ndarray) -> bool:
    """Whether numbers (H, W, C) are a color image: bytes, or multiples of 1/255 in [0, 1]."""
    if array.dtype == np.uint8:
        return True
    if min(array.shape) == 0 or array.dtype.kind != "f":
        return False
    down, across = (-(-side // _MAX_SAMPLED_SIDE) for side in array.shape[:2])
    some = array[::down, ::across].astype(np.float64) * 255
    stepped = bool((np.abs(some - np.rint(some)) < _GRAY_STEP_TOLERANCE).all())
    return stepped and some.min() >= 0 and some.max() <= 255 and len(np.unique(some)) > _MIN_SHADES


def _are_neighbors_correlated(table: np.ndarray) -> bool:
    """Whether most neighboring columns of a table (H, W) float64 are strongly correlated."""
    with np.errstate(all="ignore"):
        table = np.where(np.isfinite(table), table, np.nan)
        table = np.where(np.isnan(table), np.nanmean(table) if not np.isnan(table).all() else 0.0, table)
        table = table - table.mean(0)
        spread = np.sqrt((table**2).mean(0))
        correlation = (table[:, 1:] * table[:, :-1]).mean(0) / (spread[1:] * spread[:-1])
    return bool((correlation > _MIN_CORRELATION).mean() >= _MIN_CORRELATED_SHARE)
