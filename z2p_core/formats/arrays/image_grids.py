"""Arrays of numbers that are pictures (depth maps, height grids) rather than points with a row each."""

from __future__ import annotations

import numpy as np

MIN_GRID_COLUMNS = 7
"""Columns from which an array of two axes may be a picture: points have up to six by all means."""
_WIDE_GRID_COLUMNS, _MAX_ROWS_PER_COLUMN = 17, 4
"""From so many columns on, points are expected to be more by such a factor than their columns."""
_MIN_CORRELATION, _MIN_CORRELATED_SHARE = 0.8, 0.7
"""How alike neighbouring columns of a picture are (correlation), and the share of them that must be."""
_MAX_SAMPLED_ROWS = 2000
"""Rows of an array that are looked at."""
_MAX_SAMPLED_SIDE, _GRAY_STEP_TOLERANCE, _MIN_SHADES = 64, 0.02, 16
"""Rows and columns of a colour picture that are looked at, how exact their steps are, and how many it has at least."""
GRID_ADVICE = ("a depth map becomes points by its camera: save it as depth, and the camera's matrix as K, in one npz, "
               "or save x = (column - cx) * depth / fx, y = (row - cy) * depth / fy and z = depth; a grid of heights "
               "becomes points by the places of its columns and rows")


@np.errstate(all="ignore")  # of numbers that are no coordinates
def is_grid(table: np.ndarray, total: int | None = None) -> bool:
    """Whether numbers (H, W) are those of a picture: pixels are like their neighbours, as columns of points never are.

    An array of many columns and few rows counts as one, too; so do small whole numbers, which pictures are kept in.
    `total` is how many rows there are, where these are only the first.
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


@np.errstate(all="ignore")  # of numbers that are no coordinates
def is_picture(array: np.ndarray) -> bool:
    """Whether numbers (H, W, C) are a colour picture: bytes, or shares of 1 in steps of 1/255."""
    if array.dtype == np.uint8:
        return True
    if min(array.shape) == 0 or array.dtype.kind != "f":
        return False
    down, across = (-(-side // _MAX_SAMPLED_SIDE) for side in array.shape[:2])
    some = array[::down, ::across].astype(np.float64) * 255
    stepped = bool((np.abs(some - np.rint(some)) < _GRAY_STEP_TOLERANCE).all())
    return stepped and some.min() >= 0 and some.max() <= 255 and len(np.unique(some)) > _MIN_SHADES


def _are_neighbors_correlated(table: np.ndarray) -> bool:
    with np.errstate(all="ignore"):
        table = np.where(np.isfinite(table), table, np.nan)
        table = np.where(np.isnan(table), np.nanmean(table) if not np.isnan(table).all() else 0.0, table)
        table = table - table.mean(0)
        spread = np.sqrt((table**2).mean(0))
        correlation = (table[:, 1:] * table[:, :-1]).mean(0) / (spread[1:] * spread[:-1])
    return bool((correlation > _MIN_CORRELATION).mean() >= _MIN_CORRELATED_SHARE)
