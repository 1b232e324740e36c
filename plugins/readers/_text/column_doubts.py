"""Detects tables whose first three columns are not x, y and z: poses, images, and rows that begin otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from z2p_core.formats.arrays.image_grids import GRID_ADVICE, is_grid
from z2p_core.formats.tables.camera_poses import pose_kind
from z2p_core.formats.tables.extra_columns import are_colours, are_normals, suggest_extra_names
from z2p_core.interfaces import ScanError

MIN_ROWS = 10
"""With fewer rows, nothing is concluded from the numbers of a column."""
_MIN_DECIMAL_SHARE = 0.1
"""A column with a larger share of non-integers is not a column of integers."""
_CLOCK_STEP_TOLERANCE, _MIN_STEADY_ROWS = 0.01, 50
"""Relative deviation of a clock's steps from their median, and the least number of rows for this test."""
_EPOCH_TIME_RANGES = ((1e9, 4e9), (1e12, 4e12), (1e15, 4e15), (1e18, 4e18))
"""Plausible times since 1970 in seconds, milliseconds, microseconds and nanoseconds: coordinates are smaller."""
_MIN_CLOCK_OFFSET_SPANS = 1000.0
"""Least value of a clock, in multiples of the time that a scan takes."""


@dataclass(frozen=True)
class Doubt:
    """Columns before x, y and z: names for them, and a description for the message."""

    names: tuple[str, ...]
    description: str


@np.errstate(all="ignore")  # the numbers may be no coordinates
def is_row_index(column: np.ndarray) -> bool:
    """Whether a column (N,) counts the rows from 0 or 1."""
    return len(column) >= MIN_ROWS and column[0] in (0, 1) and bool((np.diff(column) == 1).all())


class RowIndex:
    """Whether a column that comes in parts counts the rows from 0 or 1."""

    def __init__(self) -> None:
        self._first: float | None = None
        self._rows = 0
        self._fits = True

    def follow(self, column: np.ndarray, rows: np.ndarray | None, count: int) -> None:
        """Takes the numbers (N,) of some `rows` (N,) of the next `count`; None for all of them."""
        if self._fits and len(column):
            offset = column - ((np.arange(count) if rows is None else rows) + self._rows)
            self._first = float(offset[0]) if self._first is None else self._first
            self._fits = self._first in (0.0, 1.0) and bool((offset == self._first).all())
        self._rows += count

    @property
    def counts_rows(self) -> bool:
        """Whether it does, by all that came."""
        return self._fits and self._first is not None and self._rows >= MIN_ROWS


def refuse_other_tables(sample: np.ndarray, rows: int) -> None:
    """Refuses tables without column names that are no points, by the first rows (N, M) of about `rows`.

    Raises:
        ScanError: they are a list of poses, a camera matrix or an image.
    """
    if poses := pose_kind(sample):
        raise ScanError(f"these rows are no points but {poses}; where they are, name each column, as in --columns "
                        f"{example_column_names(sample.shape[1])}")
    if is_grid(sample, rows):
        raise ScanError(f"rows of {sample.shape[1]} numbers look like a depth map or a grid of heights, not like "
                        f"points with x y z first; {GRID_ADVICE}")


@np.errstate(all="ignore")  # the numbers may be no coordinates
def find_leading_columns(points: np.ndarray, sample: np.ndarray) -> tuple[int, str]:
    """The number of columns before x, y and z in an array without names, and a description of them.

    Args:
        points: the first three columns (N, 3) of all rows.
        sample: all columns (n, M) of the first rows.

    Returns:
        0 and "" if the first columns may well be x, y and z.
    """
    if sample.shape[1] < 4:
        return 0, ""
    if is_row_index(points[:, 0]):
        return 1, "numbers of the points"
    doubt = _find_doubt(points[np.isfinite(points).all(1)], sample)
    return (len(doubt.names), doubt.description) if doubt else (0, "")


@np.errstate(all="ignore")  # the numbers may be no coordinates
def check_first_columns(points: np.ndarray, sample: np.ndarray, first: int = 1) -> None:
    """Refuses a table whose first columns look like anything but x, y and z.

    Args:
        points: the first three columns (N, 3) of all rows.
        sample: all columns (n, M) of the first rows.
        first: the number of the first column, counted from 1.

    Raises:
        ScanError: the first columns look like grid cells, labels, times, normals or colors; the message says how to
            name them.
    """
    doubt = _find_doubt(points[np.isfinite(points).all(1)], sample) if sample.shape[1] > 3 else None
    if doubt is None:
        return
    before = len(doubt.names)
    leading = [f"c{column}" for column in range(1, first)]
    rest = suggest_extra_names(sample[:, before + 3 :], first + before + 3)
    wanted = ",".join([*leading, *doubt.names, "x", "y", "z", *rest])
    plain = ",".join([*leading, "x", "y", "z", *(f"c{column + first}" for column in range(3, sample.shape[1]))])
    which = (f"column {first}", f"columns {first} and {first + 1}", f"columns {first} to {first + 2}")[before - 1]
    raise ScanError(f"{which} may be {doubt.description} rather than coordinates: say which with --columns {wanted} or "
                    f"--columns {plain}")


def example_column_names(columns: int) -> str:
    """A value for --columns that names as many columns, x, y and z first."""
    return ",".join(["x", "y", "z", *(f"c{column}" for column in range(4, columns + 1))])


def _find_doubt(points: np.ndarray, sample: np.ndarray) -> Doubt | None:
    """What the columns before x, y and z seem to hold; None if x, y and z seem to come first."""
    if len(points) < MIN_ROWS or _has_attributes_behind(sample):
        return None
    width = sample.shape[1]
    if width >= 6 and (names := _leading_attribute_names(points, sample)):
        return Doubt(names, "normals" if names[0] == "nx" else "colours")
    if width >= 5 and _are_grid_cells(points, sample):
        return Doubt(("row", "column"), "a scanner's row and column numbers")
    first, later = points[:, 0], [points[:, 1], points[:, 2], sample[:, 3]]
    all_decimal = all(map(_has_decimals, later))
    if _are_integers(first) and all_decimal:
        if _increases(first):
            return Doubt(("id",), "numbers of the points or times")
        return Doubt(("label",), "labels or numbers of scan lines")
    if _is_clock(first, points[:, 1:]):
        return Doubt(("time",), "times")
    if width == 4 and _is_class(first, later):
        return Doubt(("label",), "labels")
    return None


def _has_attributes_behind(sample: np.ndarray) -> bool:
    """Whether columns 4 to 6 are normals or colors in [0, 1], so that the three before them are x, y and z."""
    if sample.shape[1] < 6:
        return False
    three = sample[:, 3:6]
    three = three[np.isfinite(three).all(1)]
    return len(three) > 0 and (are_normals(three) or (are_colours(three) and not _are_integers(three.ravel())))


def _leading_attribute_names(points: np.ndarray, sample: np.ndarray) -> tuple[str, ...]:
    """Names of the first three columns if they are normals or colors before coordinates; otherwise empty."""
    if not all(map(_has_decimals, sample[:, 3:6].T)):
        return ()
    if are_normals(points):
        return ("nx", "ny", "nz")
    colours = _are_integers(points.ravel()) and points.min() >= 0 and 128 <= points.max() <= 255
    return ("r", "g", "b") if colours else ()


def _are_grid_cells(points: np.ndarray, sample: np.ndarray) -> bool:
    """Whether the first two columns are the row and column of grid cells, each cell once, before coordinates."""
    cells = points[:, :2]
    if not _are_integers(cells.ravel()) or cells.min() < 0 or not np.ptp(cells, axis=0).all():
        return False
    later = [points[:, 2], sample[:, 3], sample[:, 4]]
    all_decimal = all(map(_has_decimals, later))
    if not all_decimal and (sample.shape[1] >= 6 and are_colours(sample[:, 3:6])):
        return False
    steps = np.diff(cells, axis=0)
    counted = max(float((steps[:, axis] == 1).mean()) for axis in (0, 1)) > 0.8
    if not all_decimal and not (counted and np.nanmin(sample[:, 3:5]) < 0):
        return False
    return len(np.unique(cells, axis=0)) == len(cells)


def _is_clock(first: np.ndarray, others: np.ndarray) -> bool:
    """Whether a column (N,) increases like time, unlike the other columns (N, 2)."""
    steps = np.diff(first)
    if (steps < 0).any() or first[-1] == first[0]:
        return False
    if any(low <= first[0] and first[-1] <= high for low, high in _EPOCH_TIME_RANGES):
        return True
    if (np.diff(others, axis=0) >= 0).all(0).any():
        return False
    if first[0] > _MIN_CLOCK_OFFSET_SPANS * (first[-1] - first[0]) and np.abs(others).max() < first[0] / 10:
        return True
    steady = np.abs(steps - np.median(steps)) <= _CLOCK_STEP_TOLERANCE * np.median(steps)
    return len(first) >= _MIN_STEADY_ROWS and bool((steps > 0).all() and steady.mean() > 0.9)


def _is_class(first: np.ndarray, later: list[np.ndarray]) -> bool:
    """Whether a column (N,) holds few different integers from 0 on, before coordinates that are integers as well."""
    if not _are_integers(first) or first.min() < 0 or len(first) < 10 * MIN_ROWS:
        return False
    classes = len(np.unique(first))
    last = later[-1][np.isfinite(later[-1])]
    return classes <= 64 and last.size > 0 and last.min() < 0 and all(
        len(np.unique(column)) >= 10 * classes for column in later)


def _are_integers(column: np.ndarray) -> bool:
    return bool((column == np.floor(column)).all())


def _increases(column: np.ndarray) -> bool:
    return bool((np.diff(column) > 0).all())


def _has_decimals(column: np.ndarray) -> bool:
    """Whether more than a few of a column's finite numbers are no integers."""
    finite = column[np.isfinite(column)]
    return len(finite) > 0 and bool((finite != np.floor(finite)).mean() > _MIN_DECIMAL_SHARE)
