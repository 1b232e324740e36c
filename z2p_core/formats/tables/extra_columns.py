"""Recognizes colors and normals in the columns behind x, y and z by their numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_UNIT_LENGTH_TOLERANCE = 0.02
"""Deviation from unit length that a normal may have."""
_MIN_UNIT_SHARE = 0.95
"""Least share of unit vectors among the nonzero rows; rows without a normal hold zeros."""
_MIN_ROWS = 10
"""With fewer rows, columns are taken for nothing by their numbers."""
_MIN_LARGEST_BYTE, _MIN_LARGEST_SHORT, _MIN_LARGEST_SHARE = 32, 16384, 0.1
"""Colors of 8 and 16 bits, and shares of 1, reach these numbers at least; small integers are counts and classes."""
_MAX_CHANNEL_RATIO = {255: 8.0, 65535: 4.0, 1: 8.0}
"""Ratio of the largest numbers of two channels, by what full intensity is: an intensity beside classes has more."""
_MIN_COPY_CORRELATION = 0.999
"""A column that follows x, y or z so closely is made of it: a height, or a coordinate in the unit cube."""
_SUM_TOLERANCE = 1e-3
"""Three shares whose sum deviates from 1 by less are parts of a whole, such as probabilities."""
_CHECKED_ROWS = 10_000
"""Rows from all over a file on which a guess from its first ones is tried."""
_COLOR_NAMES, _NORMAL_NAMES = ("r", "g", "b"), ("nx", "ny", "nz")


@dataclass(frozen=True)
class ColumnGuess:
    """What columns behind x, y and z hold by their numbers."""

    names: tuple[str, ...]
    """``r``, ``g``, ``b``, ``nx``, ``ny``, ``nz``, or empty for what is not known."""
    doubtful: tuple[int, ...] = ()
    """Indices of the columns of which three may be colors, where it is not known which."""

    def note(self, first: int) -> str:
        """The note for the user; `first` is the number of the first column, counted from 1."""
        if "r" in self.names:
            start = first + self.names.index("r")
            return f"columns {start} to {start + 2} taken as colours"
        if self.doubtful:
            start, end = first + self.doubtful[0], first + self.doubtful[-1]
            return f"no colours: which of columns {start} to {end} they are is not known"
        return ""


@np.errstate(all="ignore")  # the numbers may be no coordinates
def guess_columns(columns: np.ndarray, points: np.ndarray) -> ColumnGuess:
    """What columns (N, M) beside points (N, 3) hold: normals and colors where their numbers leave no doubt.

    Wrong colors are worse than none, so three columns of counts, classes, coordinates or shares are none, and neither
    are those of four columns of which any three could be.
    """
    names = [""] * columns.shape[1]
    if len(columns) < _MIN_ROWS:
        return ColumnGuess(tuple(names))
    start = 0
    while start + 3 <= len(names):
        if _NORMAL_NAMES[0] not in names and are_normals(columns[:, start : start + 3]):
            names[start : start + 3] = _NORMAL_NAMES
            start += 2
        start += 1
    free = [start for start in range(len(names) - 2) if not any(names[start : start + 3])]
    colors = [start for start in free if _are_surely_colors(columns[:, start : start + 3], points)]
    varied = [start for start in colors if (np.nanstd(columns[:, start : start + 3], axis=0) > 0).all()]
    colors = varied or colors
    if not colors:
        return ColumnGuess(tuple(names))
    if len(colors) > 1 and colors[1] < colors[0] + 3:
        run = next((at for at in range(1, len(colors)) if colors[at] != colors[at - 1] + 1), len(colors))
        return ColumnGuess(tuple(names), tuple(range(colors[0], colors[run - 1] + 3)))
    names[colors[0] : colors[0] + 3] = _COLOR_NAMES
    return ColumnGuess(tuple(names))


@np.errstate(all="ignore")  # the numbers may be no coordinates
def colors_hold(three: np.ndarray, points: np.ndarray) -> bool:
    """Whether columns (N, 3) beside all points (N, 3) of a file are colors, as its first rows let one guess."""
    step = -(-len(three) // _CHECKED_ROWS) or 1
    return are_colours(three) and _are_surely_colors(three[::step], points[::step])


def _are_surely_colors(three: np.ndarray, points: np.ndarray) -> bool:
    """Whether rows (N, 3) beside points (N, 3) can be nothing else than red, green and blue."""
    known = np.isfinite(three).all(1) & np.isfinite(points).all(1)
    three, points = three[known], points[known]
    if len(three) < _MIN_ROWS or not are_colours(three) or not np.ptp(three, axis=0).any():
        return False
    largest = three.max(axis=0)
    full, least = (1, _MIN_LARGEST_SHARE) if largest.max() <= 1 else (
        (255, _MIN_LARGEST_BYTE) if largest.max() <= 255 else (65535, _MIN_LARGEST_SHORT))
    varied = largest[np.ptp(three, axis=0) > 0]
    if largest.max() < least or varied.max() > _MAX_CHANNEL_RATIO[full] * varied.min():
        return False
    if any(len(np.unique(column)) >= _MIN_ROWS and (np.diff(column) >= 0).all() for column in three.T):
        return False  # they count
    if full == 1 and (np.abs(three.sum(1) - 1) < _SUM_TOLERANCE).mean() > 0.9:
        return False
    return not any(_is_copy(column, axis) for column in three.T for axis in points.T)


def _is_copy(column: np.ndarray, axis: np.ndarray) -> bool:
    """Whether a column (N,) is a linear function of a coordinate (N,)."""
    if np.ptp(column) == 0 or np.ptp(axis) == 0:
        return False
    return abs(float(np.corrcoef(column, axis)[0, 1])) > _MIN_COPY_CORRELATION


@np.errstate(all="ignore")  # the numbers may be no coordinates
def suggest_extra_names(columns: np.ndarray, first: int) -> list[str]:
    """Names for columns (N, M) in --columns: ``r``, ``g``, ``b``, ``nx`` ..., and ``c9`` for unknown contents."""
    names: list[str] = []
    for kind, start, count in _group_columns(columns):
        known = {"colours": ["r", "g", "b"], "normals": ["nx", "ny", "nz"]}.get(kind, [])
        names += known if known and known[0] not in names else [f"c{first + start + index}" for index in range(count)]
    return names


@np.errstate(all="ignore")  # the numbers may be no coordinates
def are_normals(columns: np.ndarray) -> bool:
    """Whether rows (N, 3) are unit vectors; some may be zero."""
    lengths = np.sqrt((columns**2).sum(1))
    some = lengths > _UNIT_LENGTH_TOLERANCE
    are_units = np.abs(lengths[some] - 1) < _UNIT_LENGTH_TOLERANCE
    return bool(some.any() and are_units.mean() >= _MIN_UNIT_SHARE and some.mean() > 0.5)


def are_colours(columns: np.ndarray) -> bool:
    """Whether rows (N, 3) could be red, green and blue: integers up to 255 or 65535, or numbers in [0, 1].

    Integers that are all 0 or 1 are no colors.
    """
    finite = columns[np.isfinite(columns).all(1)]
    if len(finite) == 0 or finite.min() < 0:
        return False
    whole = bool((finite == np.floor(finite)).all())
    return finite.max() <= 1 if not whole else 1 < finite.max() <= 65535


def _group_columns(columns: np.ndarray) -> list[tuple[str, int, int]]:
    """Runs of columns of one kind: the kind (or ""), the index of the first column, and their number."""
    groups: list[tuple[str, int, int]] = []
    start = 0
    while start < columns.shape[1]:
        three = columns[:, start : start + 3]
        with np.errstate(all="ignore"):
            kind = "" if three.shape[1] < 3 else "normals" if are_normals(three) else ""
            kind = "colours" if not kind and three.shape[1] == 3 and are_colours(three) else kind
        if kind:
            groups.append((kind, start, 3))
        elif groups and not groups[-1][0]:
            groups[-1] = ("", groups[-1][1], groups[-1][2] + 1)
        else:
            groups.append(("", start, 1))
        start += 3 if kind else 1
    return groups
