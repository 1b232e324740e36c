"""What speaks against the first three columns of a table being x, y and z, and which columns may hold them instead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from z2p_core.formats.arrays.image_grids import GRID_ADVICE, is_grid
from z2p_core.formats.tables.camera_poses import pose_kind
from z2p_core.formats.tables.extra_columns import are_colours, are_normals, suggest_extra_names
from z2p_core.interfaces import ScanError

MIN_ROWS = 10
"""Rows from which a column of 0, 1, 2 ... is no chance."""
_MIN_DECIMAL_SHARE = 0.1
"""Share of numbers with decimals from which on a column is none of whole numbers."""
_CLOCK_STEP_TOLERANCE, _MIN_STEADY_ROWS = 0.01, 50
"""How far the steps of a clock may differ from their median, and the rows that tell it."""
_EPOCH_TIME_RANGES = ((1e9, 4e9), (1e12, 4e12), (1e15, 4e15), (1e18, 4e18))
"""Seconds since 1970, and thousandths, millionths and billionths of them: no scanner's coordinates are as large."""
_MIN_CLOCK_OFFSET_SPANS = 1000.0
"""How far from 0 a clock's reading is at least, in what passes while a cloud is measured."""


@dataclass(frozen=True)
class Doubt:
    """Columns that stand before x, y and z: their names, and what they look like."""

    names: tuple[str, ...]
    description: str


@np.errstate(all="ignore")  # of numbers that are no coordinates
def is_row_index(column: np.ndarray) -> bool:
    """Whether a column (N,) numbers its rows, from 0 or 1 on."""
    return len(column) >= MIN_ROWS and column[0] in (0, 1) and bool((np.diff(column) == 1).all())


def refuse_other_tables(sample: np.ndarray, rows: int) -> None:
    """None where the first rows (N, M), of so many `rows` about, of a table that nobody names may be points.

    Raises:
        ScanError: they are a list of poses, a camera's matrix, or a picture.
    """
    if poses := pose_kind(sample):
        raise ScanError(f"these rows are no points but {poses}; where they are, name each column, as in --columns "
                        f"{example_column_names(sample.shape[1])}")
    if is_grid(sample, rows):
        raise ScanError(f"rows of {sample.shape[1]} numbers look like a depth map or a grid of heights, not like "
                        f"points with x y z first; {GRID_ADVICE}")


@np.errstate(all="ignore")  # of numbers that are no coordinates
def find_leading_columns(points: np.ndarray, sample: np.ndarray) -> tuple[int, str]:
    """How many columns seem to stand before x, y and z, and what they look like, in an array that nobody names.

    points (N, 3): its first columns; `sample` (n, M): all columns of its first rows.
    """
    if sample.shape[1] < 4:
        return 0, ""
    if is_row_index(points[:, 0]):
        return 1, "numbers of the points"
    doubt = _find_doubt(points[np.isfinite(points).all(1)], sample)
    return (len(doubt.names), doubt.description) if doubt else (0, "")


@np.errstate(all="ignore")  # of numbers that are no coordinates
def check_first_columns(points: np.ndarray, sample: np.ndarray, first: int = 1) -> None:
    """None where the first three of more columns may well be x, y and z: points (N, 3) of the whole file.

    `sample` (n, M): all columns of its first rows; `first`: the number of the first of them.

    Raises:
        ScanError: they look like a scanner's row and column, like a label or like a time; it says how to name them.
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
    """Names for so many columns, of which x, y and z come first, as --columns takes them."""
    return ",".join(["x", "y", "z", *(f"c{column}" for column in range(4, columns + 1))])


def _find_doubt(points: np.ndarray, sample: np.ndarray) -> Doubt | None:
    """What the columns before x, y and z seem to be; None if there are none."""
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
    """Whether columns 4 to 6 are normals or shares of colours, so that the three before them are x, y and z."""
    if sample.shape[1] < 6:
        return False
    three = sample[:, 3:6]
    three = three[np.isfinite(three).all(1)]
    return len(three) > 0 and (are_normals(three) or (are_colours(three) and not _are_integers(three.ravel())))


def _leading_attribute_names(points: np.ndarray, sample: np.ndarray) -> tuple[str, ...]:
    """Names of what the first three columns hold, where it is normals or colours before coordinates; else none."""
    if not all(map(_has_decimals, sample[:, 3:6].T)):
        return ()
    if are_normals(points):
        return ("nx", "ny", "nz")
    colours = _are_integers(points.ravel()) and points.min() >= 0 and 128 <= points.max() <= 255
    return ("r", "g", "b") if colours else ()


def _are_grid_cells(points: np.ndarray, sample: np.ndarray) -> bool:
    """Whether the first two columns are the row and column of a cell, each but once, with coordinates behind them."""
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
    """Whether a column (N,) grows as time does, which others (N, 2) do not."""
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
    """Whether a column (N,) holds few whole numbers from 0 on before coordinates that are whole as well."""
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
    """Whether a column's numbers have decimals."""
    finite = column[np.isfinite(column)]
    return len(finite) > 0 and bool((finite != np.floor(finite)).mean() > _MIN_DECIMAL_SHARE)
