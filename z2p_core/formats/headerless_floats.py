"""Infers the column layout of a headerless float32 file from its values."""

from __future__ import annotations

import numpy as np

from z2p_core.formats.raw_lidar import KITTI_COLUMNS, NUSCENES_COLUMNS, is_plausible_sweep

COLOR_COLUMNS = ("x", "y", "z", "r", "g", "b")
NORMAL_COLUMNS = ("x", "y", "z", "nx", "ny", "nz")
LAYOUTS = (KITTI_COLUMNS, NUSCENES_COLUMNS, COLOR_COLUMNS, NORMAL_COLUMNS)
"""The known layouts of a row."""
SWEEP_LAYOUTS = (KITTI_COLUMNS, NUSCENES_COLUMNS)
"""Layouts that are read without --columns, because data sets use them."""
SAMPLE_NUMBERS = 60 * 1000
"""How many values at the beginning of a file are examined: whole rows of every layout."""
_PERIODS_ROWS = range(2, 7)
"""Periods, in rows, after which the true columns repeat if the row length is wrong."""
_MIN_KS_DISTANCE = 0.25
"""Columns of different meaning differ at least this much in distribution (Kolmogorov-Smirnov distance)."""
_KS_CHANCE_FACTOR = 1.7
"""Times sqrt(2 / n): Kolmogorov-Smirnov distance that n samples of one distribution may have by chance."""
_UNIT_LENGTH_TOLERANCE = 0.02
"""Deviation from unit length that a normal may have."""

_MIN_MAGNITUDE, _MAX_MAGNITUDE = 1e-9, 1e9
"""Range of the magnitude of plausible measured values other than 0."""
_MIN_HALVES, _MIN_IMPLAUSIBLE_SHARE = 60, 0.3
"""Values needed to recognize float64, and the least share of implausible low halves: random bits give 0.76."""


def matching_layouts(values: np.ndarray, size: int) -> list[tuple[str, ...]]:
    """The layouts that fit a file of `size` bytes that begins with values (N,) float32."""
    return [layout for layout in LAYOUTS if size and not size % (4 * len(layout)) and _fits(values, layout)]


def are_float64_halves(values: np.ndarray) -> bool:
    """Whether values (N,) float32 are the halves of float64 numbers: plausible as pairs, implausible one by one.

    The low halves of float64 numbers are random bits, which are often implausible as float32.
    """
    values = values[: len(values) // 2 * 2]
    if len(values) < _MIN_HALVES:
        return False
    joined, low = np.abs(values.astype("<f4").view("<f8")), np.abs(values[0::2])
    plausible = (joined == 0) | ((joined > _MIN_MAGNITUDE) & (joined < _MAX_MAGNITUDE))
    implausible = ~np.isfinite(low) | (low > _MAX_MAGNITUDE) | ((low < _MIN_MAGNITUDE) & (low > 0))
    return bool(plausible.all()) and float(implausible.mean()) > _MIN_IMPLAUSIBLE_SHARE


def suggest_columns(size: int) -> list[str]:
    """Values for --columns with which a file of `size` bytes has whole rows."""
    layouts = (("x", "y", "z"), KITTI_COLUMNS, NUSCENES_COLUMNS, COLOR_COLUMNS)
    return [",".join(layout) for layout in layouts if size and not size % (4 * len(layout))]


def _fits(values: np.ndarray, layout: tuple[str, ...]) -> bool:
    """Whether the values, cut into rows of that layout, are plausible."""
    rows = values[: len(values) // len(layout) * len(layout)].reshape(-1, len(layout))
    if len(rows) == 0 or not is_plausible_sweep(np.column_stack([rows[:, :3], np.zeros(len(rows), np.float32)])):
        return False
    rest = rows[:, 3:]
    if not np.isfinite(rest).all():
        return False
    if layout == NORMAL_COLUMNS:
        length = np.linalg.norm(rest, axis=1)
        fits = np.mean((np.abs(length - 1) < _UNIT_LENGTH_TOLERANCE) | (length == 0)) > 0.98 and bool(rest.any())
    elif layout == COLOR_COLUMNS:
        fits = _are_whole(rest, 255) or bool(((rest >= 0) & (rest <= 1)).all())
    else:
        fits = is_plausible_sweep(rows) and (layout == KITTI_COLUMNS or _are_whole(rest[:, 1:], 255))
    return bool(fits) and not _is_mixed(rows)


def _are_whole(numbers: np.ndarray, maximum: int) -> bool:
    return bool(((numbers >= 0) & (numbers <= maximum) & (numbers == np.floor(numbers))).all())


def _is_mixed(rows: np.ndarray) -> bool:
    """Whether most columns (N, C) have another distribution in every k-th row, for a k of `_PERIODS_ROWS`.

    That is the case if the row length is wrong. Lidars with alternating beams show it in the height alone.
    """
    order = np.argsort(rows, axis=0, kind="stable")
    for period in _PERIODS_ROWS:
        if len(rows) < 8 * period:
            break
        threshold = max(_MIN_KS_DISTANCE, _KS_CHANCE_FACTOR * (2 * period / len(rows)) ** 0.5)
        if (_max_ks_distance(rows, order, period) > threshold).mean() >= 0.5:
            return True
    return False


def _max_ks_distance(rows: np.ndarray, order: np.ndarray, period: int) -> np.ndarray:
    """For each column (C,), the largest Kolmogorov-Smirnov distance of every `period`-th row to all rows."""
    whole = np.arange(1, len(rows) + 1)[:, None] / len(rows)
    ranked = np.take_along_axis(rows, order, axis=0)
    last = np.ones(rows.shape, dtype=bool)  # of equal values, only the last one counts
    last[:-1] = ranked[1:] != ranked[:-1]
    distance = np.zeros(rows.shape[1])
    for phase in range(period):
        within = order % period == phase
        share = np.cumsum(within, axis=0) / within.sum(axis=0)
        distance = np.maximum(distance, (np.abs(share - whole) * last).max(axis=0))
    return distance
