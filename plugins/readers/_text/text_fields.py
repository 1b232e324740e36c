"""Which columns of a text are fields of the points, by their names, by the format, or by their numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from z2p_core.formats.tables.extra_columns import ColumnGuess, are_colours, are_normals, colors_hold, guess_columns
from z2p_core.formats.tables.header_lines import column_titles, column_units
from z2p_core.interfaces import RawCloud
from z2p_renderer.plugins.readers._helpers.point_fields import FieldPlan, Wants, plan_fields, whole_if_whole
from z2p_renderer.plugins.readers._text.header import Head
from z2p_renderer.plugins.readers._text.row_format import RowFormat

_COLORS, _NORMALS = ("r", "g", "b"), ("nx", "ny", "nz")
_FORMAT_COLUMNS: dict[str, dict[int, tuple[str, ...]]] = {
    ".pts": {1: ("intensity",), 3: _COLORS, 4: ("intensity", *_COLORS)},
    ".xyzrgb": {3: _COLORS},
    ".xyzn": {3: _NORMALS},
}
"""Columns behind x, y and z by the suffix and by their number."""
TRACK_LENGTH = "track_length"


@dataclass(frozen=True)
class TextFields:
    """The fields of a text's columns."""

    plan: FieldPlan
    units: Mapping[str, str]
    note: str = ""
    guessed: bool = False
    """Whether colors are recognized by the numbers of the first rows alone."""

    def apply_to(self, row_format: RowFormat) -> RowFormat:
        """The row format with the columns that are needed."""
        columns = tuple(column for column in self.plan.columns if column < row_format.width)
        return replace(row_format, field_columns=columns, list_lengths=len(columns) < len(self.plan.columns))

    def fill(self, cloud: RawCloud, values: np.ndarray) -> RawCloud:
        """The cloud with its fields; `values` (N, M) are the columns that the row format of `apply_to` reads."""
        plan, note = self.plan, self.note
        columns = {column: values[:, index] for index, column in enumerate(plan.columns)}
        if self.guessed and "rgb" in plan.needed:
            three = np.column_stack([columns[column] for column in plan.columns_of["rgb"]])
            if not colors_hold(three, cloud.points):
                plan, note = plan.without("rgb"), ""
        scalars = {plan.columns_of[name][0] for name in plan.needed if name not in ("rgb", "normal")}
        columns.update({column: whole_if_whole(columns[column]) for column in scalars})
        if TRACK_LENGTH in plan.needed:
            track = plan.columns_of[TRACK_LENGTH][0]
            columns[track] = columns[track] // 2  # an image and a feature each
        filled = plan.fill(replace(cloud, note="; ".join(filter(None, [cloud.note, note]))), columns)
        return replace(filled, units={name: unit for name, unit in self.units.items() if name in plan.columns_of})


def named_fields(row_format: RowFormat, head: Head, sample: np.ndarray, wants: Wants) -> TextFields:
    """The fields of a table with names, by the `sample` (n, width) of its rows; columns of words are none.

    `head` is that of a file that names its columns itself.
    """
    titles = column_titles(head.title) if head.title else {}
    names = [titles.get(name, name) for name in row_format.names[: row_format.width]]
    words = {column for column in range(sample.shape[1]) if not np.isfinite(sample[:, column]).any()}
    if head.colmap and row_format.ragged:
        names.append(TRACK_LENGTH)
    plan = plan_fields(names, wants, row_format.xyz_columns)
    plan = plan.without(*(name for name, columns in plan.columns_of.items() if set(columns) & words))
    units = {name: unit for name, unit in column_units(head.title).items() if name not in "xyzXYZ"}
    if head.colmap:
        units = {"error": "px", "ERROR": "px"}
    return TextFields(plan, units)


def unnamed_fields(row_format: RowFormat, sample: np.ndarray, suffix: str, wants: Wants) -> TextFields:
    """The fields of a table without names, by its suffix or by the `sample` (n, width) of its first rows."""
    first = row_format.xyz_columns[-1] + 1
    points, others = sample[:, first - 3 : first], sample[:, first:]
    fixed = _FORMAT_COLUMNS.get(suffix, {}).get(others.shape[1]) if first == 3 else None
    is_fixed = fixed is not None and _fits(fixed, others)
    guess = ColumnGuess(fixed) if is_fixed and fixed is not None else guess_columns(others, points)
    names = [*[""] * (first - 3), "x", "y", "z", *guess.names]
    plan = plan_fields(names, wants, row_format.xyz_columns)
    is_guessed = not is_fixed and "r" in guess.names
    note = "" if is_fixed or not wants("rgb") else guess.note(first + 1)
    return TextFields(plan, {}, note, is_guessed)


def _fits(names: tuple[str, ...], columns: np.ndarray) -> bool:
    """Whether columns (N, M) may hold what a format's names say: writers do not all keep to it."""
    with np.errstate(all="ignore"):
        if names == _NORMALS:
            return are_normals(columns)
        if names[-3:] == _COLORS:
            return are_colours(columns[:, -3:]) and np.nanmax(columns[:, -3:]) <= 255
    return True
