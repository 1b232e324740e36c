"""Points of a text file: xyz, xyzn, xyzrgb and pts with the columns that Open3D gives them, and txt, asc, csv, tsv."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path

import numpy as np

from z2p_core.formats.geographic import project_degrees
from z2p_core.formats.tables.camera_poses import name_poses
from z2p_core.formats.tables.extra_columns import ignored_colors_note, ignored_columns_note
from z2p_core.formats.tables.header_lines import is_count, is_row
from z2p_core.interfaces import RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily
from z2p_renderer.plugins.readers._text.column_doubts import (
    check_first_columns,
    is_row_index,
    refuse_other_tables,
    some_names,
)
from z2p_renderer.plugins.readers._text.esri_grid import is_raster, raster_points
from z2p_renderer.plugins.readers._text.header import Head, as_colmap, parse_head
from z2p_renderer.plugins.readers._text.line_blocks import content, has_long_lines, line_number, truncation_hint
from z2p_renderer.plugins.readers._text.memory_need import memory_of_lines
from z2p_renderer.plugins.readers._text.row_format import SAMPLE, BadLineError, RowFormat, detect_row_format
from z2p_renderer.plugins.readers._text.unsupported_notations import missing_height_hint, notation_message

_MOST_IN_LONG_LINES = 1 << 28
"""Bytes that a text at most takes whose rows are too long to be points."""
_MOST_CELLS, _FEWEST_ROWS = 60_000, 20
"""Cells of the first rows that are looked at, and rows at least."""


class Text(Reader):
    """Plain text, a point a line, numbers parted by blanks, commas or semicolons; ``#`` begins a comment."""

    name = "text"
    version = "8"
    suffixes = (".xyz", ".xyzn", ".xyzrgb", ".pts", ".txt", ".asc", ".csv", ".tsv")

    def memory(self, path: Path) -> int:
        """As many points as the first lines let expect; the text is read in parts, and endless lines are refused."""
        return min(memory_of_lines(path), _MOST_IN_LONG_LINES) if has_long_lines(path) else memory_of_lines(path)

    def read(self, path: Path) -> list[RawCloud | np.ndarray]:
        """The first three columns, or those called x, y, z, one cloud (N, 3) float64; an empty cell is NaN.

        Where nobody names the columns and the first of four or more counts the rows, it is no x: the next three are.

        A line before the rows may hold their count, as in every .pts, where several scans may follow one another. There
        may be a line of names, among them x, y and z; the columns beside those three may then hold words. An ESRI grid
        gives the middles of its cells.

        Raises:
            ScanError: fewer than three columns, others than the user named, first ones that look like anything but x,
                y and z, a list of poses, a picture, something not a number, or a wrong count.
        """
        blocks = content(path)
        first: list[str] = next(blocks, [])
        if is_raster(first):
            return [RawCloud(raster_points(first, blocks), note="an ESRI grid, a point a cell", up="+Z",
                             up_reason="its numbers are heights")]
        head = parse_head(first, path.suffix.lower(), self.columns is not None)
        rows = first[head.lines :] or next(blocks, [])
        if not rows:
            _check_counts(path, head, _Rows())
            return [np.empty((0, 3))]
        if _is_bare_colmap(path, head, rows) and not self.columns:
            head = as_colmap(head)
        form = self._form(path, head, rows)
        if form.named:
            if not self.columns and name_poses(form.names):
                raise ScanError(f"the columns {','.join(form.names)[:160]} are a list of poses, no points; to draw its "
                                "places, name each column with --columns")
            found = _table(path, form, head, chain([rows], blocks))
            _check_counts(path, head, found)
            return [_named(found, form, Head() if self.columns else head, path)]
        sample = form.table(rows[: max(min(SAMPLE, _MOST_CELLS // form.width), _FEWEST_ROWS)])
        refuse_other_tables(sample, path.stat().st_size // (len(rows[0]) + 1))
        found = _table(path, form, head, chain([rows], blocks))
        _check_counts(path, head, found)
        if form.width > 3 and is_row_index(found.points[:, 0]):
            found = _table(path, replace(form, places=(1, 2, 3)), head, _rows_again(path, head))
            check_first_columns(found.points, sample[:, 1:], 2)
            told = ignored_columns_note(sample[:, 4:], 5)
            return [RawCloud(found.points, note=_joined(_told_numbers(form.width), told, found.told))]
        check_first_columns(found.points, sample)
        return [RawCloud(found.points, note=_joined(ignored_columns_note(sample[:, 3:]), found.told))]

    def _form(self, path: Path, head: Head, rows: list[str]) -> RowFormat:
        """How the rows, of which these are the first, are written.

        Raises:
            ScanError: as `read` says.
        """
        try:
            return detect_row_format(rows, head, self.columns)
        except ScanError as error:
            raise ScanError(f"line {line_number(path, head.lines)}: {notation_message(rows[:2]) or error}"
                            f"{truncation_hint(path, head.lines)}") from error


@dataclass
class _Rows:
    """Points of one scan after the other."""

    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    counts: list[int] = field(default_factory=lambda: [0])
    """How many points each scan has."""
    promised: list[tuple[str, int]] = field(default_factory=list)
    """The counts before the second scan and all later ones, and the index of the line that holds it."""

    @property
    def told(self) -> str:
        """What to say of several scans."""
        return f"{len(self.counts)} scans in one file" if len(self.counts) > 1 else ""


def _named(found: _Rows, form: RowFormat, head: Head, path: Path) -> RawCloud:
    """The points of a table whose columns have names, which say what the numbers are; those of no title, nothing."""
    points, told = found.points, [ignored_colors_note(form.names), found.told]
    if head.depth:
        positive = bool(np.nanmedian(points[:, 2]) > 0) if np.isfinite(points[:, 2]).any() else False
        points = points * [1, 1, -1] if positive else points
        told.append("depths count down, so z = -depth" if positive else "depths below 0 are taken as heights")
    if head.degrees:
        points, laid_out = project_degrees(points)
        told.append(laid_out)
    if head.colmap:
        colmap = import_lazily("z2p_renderer.plugins.readers._cameras.colmap")
        cloud: RawCloud = colmap.with_colmap_cameras(points, path, _joined(*told))
        return cloud
    if head.heights:
        return RawCloud(points, note=_joined(*told), up="+Z", up_reason="z is a height by its columns' names")
    return RawCloud(points, note=_joined(*told))


def _is_bare_colmap(path: Path, head: Head, rows: list[str]) -> bool:
    """Whether this is COLMAP's list of points by its name, though no comment says what the columns hold."""
    return path.stem.lower() == "points3d" and not head.names and min(len(row.split()) for row in rows[:SAMPLE]) >= 8


def _joined(*told: str) -> str:
    return "; ".join(filter(None, told))


def _told_numbers(width: int) -> str:
    return f"column 1 counts the rows, so x y z are columns 2 to 4; --columns {some_names(width)} takes it as x"


def _check_counts(path: Path, head: Head, found: _Rows) -> None:
    """Raises ScanError where a scan has not as many points as the line before it says; the first may count all."""
    if head.promised is None or (found.promised and head.promised == str(len(found.points))):
        return
    for (promised, at), count in zip([(head.promised, head.promised_at), *found.promised], found.counts, strict=True):
        if promised.strip() != str(count):
            raise ScanError(f"line {line_number(path, at)} promises {promised.strip()[:40]!r} points, {count} came; "
                            "mend the number, take the line out, or export the file again")


def _rows_again(path: Path, head: Head) -> Iterable[list[str]]:
    """The blocks of rows of a file that has been read before."""
    blocks = content(path)
    first: list[str] = next(blocks, [])
    return chain([first[head.lines :] or next(blocks, [])], blocks)


def _table(path: Path, form: RowFormat, head: Head, blocks: Iterable[list[str]]) -> _Rows:
    """Points of blocks of rows, among which may stand the counts of more scans."""
    parts, found, before = [np.empty((0, 3))], _Rows(), head.lines
    several = head.promised is not None and (not form.named or path.suffix.lower() == ".pts")
    for rows in blocks:
        try:
            pieces = [form.points(rows)]
            found.counts[-1] += len(rows)
        except BadLineError as error:
            if not several or not any(map(is_count, rows)):
                raise _told_bad(error, form, rows, path, before) from error
            pieces = _pieces(path, form, rows, before, found)
        parts += pieces
        before += len(rows)
    found.points = np.concatenate(parts)
    return found


def _pieces(path: Path, form: RowFormat, rows: list[str], before: int, found: _Rows) -> list[np.ndarray]:
    """Points of the rows between lines that count those of the next scan."""
    marks = [index for index, row in enumerate(rows) if is_count(row)]
    parts = []
    for start, end in zip([0, *(mark + 1 for mark in marks)], [*marks, len(rows)], strict=True):
        if start:
            found.promised.append((rows[start - 1], before + start - 1))
            found.counts.append(0)
        if start < end:
            try:
                parts.append(form.points(rows[start:end]))
            except BadLineError as error:
                raise _told_bad(error, form, rows[start:end], path, before + start) from error
            found.counts[-1] += end - start
    return parts


def _told_bad(error: BadLineError, form: RowFormat, lines: list[str], path: Path, before: int) -> ScanError:
    """What is wrong with a line of those that have `before` others with content before them in the file."""
    index = before + error.index
    if told := notation_message(lines[error.index : error.index + 2]):
        return ScanError(f"line {line_number(path, index)}: {told}")
    title = lines[0]
    if index == 0 and not is_row(title):
        return ScanError(f"line {line_number(path, 0)}: expected points, or names of columns with x, y and z once "
                         f"each, got {title.strip()[:60]!r}; name all columns, as in --columns x,y,z,label"
                         f"{missing_height_hint(title)}")
    hint = "" if form.named else "; where columns hold words, name all of them, as in --columns x,y,z,label"
    return ScanError(f"expected the same count of numbers on every line, but in line {line_number(path, index)} "
                     f"{error}; put '#' before lines that are no points{hint}{truncation_hint(path, index)}")
