"""Points of a text file: xyz, xyzn, xyzrgb and pts with the columns that Open3D gives them, and txt, asc, csv, tsv."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path

import numpy as np

from z2p_core.formats.geographic import project_degrees
from z2p_core.formats.row_subsampling import ThinnedRows
from z2p_core.formats.tables.camera_poses import are_pose_names
from z2p_core.formats.tables.header_lines import is_count, is_row
from z2p_core.interfaces import RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily
from z2p_renderer.plugins.readers._text.column_doubts import (
    RowIndex,
    check_first_columns,
    example_column_names,
    refuse_other_tables,
)
from z2p_renderer.plugins.readers._text.esri_grid import is_esri_grid, read_esri_grid
from z2p_renderer.plugins.readers._text.header import Head, as_colmap, parse_head
from z2p_renderer.plugins.readers._text.line_blocks import content_blocks, has_long_lines, line_number, truncation_hint
from z2p_renderer.plugins.readers._text.memory_need import estimate_lines, memory_of_lines
from z2p_renderer.plugins.readers._text.row_format import SAMPLE_ROWS, BadLineError, RowFormat, detect_row_format
from z2p_renderer.plugins.readers._text.text_fields import TextFields, named_fields, unnamed_fields
from z2p_renderer.plugins.readers._text.unsupported_notations import missing_height_hint, notation_message

_MAX_LONG_LINE_MEMORY_BYTES = 1 << 28
"""Upper bound of the memory for a text whose lines are too long to be points: it is refused early."""
_MAX_SAMPLE_CELLS, _MIN_SAMPLE_ROWS = 60_000, 20
"""Largest number of cells, and least number of rows, of the sample from which columns are judged."""
_NAMED_SAMPLE_ROWS = 200
"""Rows of a table with names in which a column without any number counts as one of words."""


class Text(Reader):
    """Plain text, a point a line, numbers parted by blanks, commas or semicolons; ``#`` begins a comment."""

    name = "text"
    version = "9"
    suffixes = (".xyz", ".xyzn", ".xyzrgb", ".pts", ".txt", ".asc", ".csv", ".tsv")

    def memory(self, path: Path) -> int:
        """An estimate from the first lines; the text is read in blocks, and lines of any length are refused early."""
        needed = memory_of_lines(path, self.max_rows)
        return min(needed, _MAX_LONG_LINE_MEMORY_BYTES) if has_long_lines(path) else needed

    def read(self, path: Path) -> list[RawCloud | np.ndarray]:
        """Reads the columns named x, y, z, or else the first three, as one cloud (N, 3) float64; an empty cell is NaN.

        If the columns have no names and the first of four or more counts the rows, the next three are x, y and z.

        A line before the rows may hold their number, as in every .pts file, where several scans may follow one another.
        If a line names the columns, the columns beside x, y and z may hold words. An ESRI grid becomes the centers of
        its cells.

        Raises:
            ScanError: the file has fewer than three columns, other columns than the user named, first columns that do
                not look like x, y and z, a cell that is no number, or a wrong number of rows; or it holds poses or an
                image.
        """
        blocks = content_blocks(path)
        first: list[str] = next(blocks, [])
        if is_esri_grid(first):
            return [RawCloud(read_esri_grid(first, blocks), note="an ESRI grid, a point a cell", up="+Z",
                             up_reason="its numbers are heights")]
        head = parse_head(first, path.suffix.lower(), self.columns is not None)
        rows = first[head.lines :] or next(blocks, [])
        if not rows:
            _check_counts(path, head, _TableScans())
            return [np.empty((0, 3))]
        if _is_bare_colmap(path, head, rows) and not self.columns:
            head = as_colmap(head)
        row_format = self._detect_row_format(path, head, rows)
        if row_format.named:
            return [self._read_named(path, row_format, head, rows, chain([rows], blocks))]
        return [self._read_unnamed(path, row_format, head, rows, chain([rows], blocks))]

    def _read_named(
        self, path: Path, row_format: RowFormat, head: Head, rows: list[str], blocks: Iterable[list[str]]
    ) -> RawCloud:
        """Reads a table whose columns are named by the user or the file; `rows` are the first of its `blocks`.

        Raises:
            ScanError: see `read`.
        """
        if not self.columns and are_pose_names(row_format.names):
            raise ScanError(f"the columns {','.join(row_format.names)[:160]} are a list of poses, no points; to draw "
                            "its places, name each column with --columns")
        head_of_names = Head() if self.columns else head
        fields = named_fields(row_format, head_of_names, row_format.table(rows[:_NAMED_SAMPLE_ROWS]), self.wants)
        scans = _read_table(path, fields.apply_to(row_format), head, blocks, self.max_rows)
        _check_counts(path, head, scans)
        return fields.fill(replace(_named_cloud(scans, head_of_names, path), total=scans.total), scans.values)

    def _read_unnamed(
        self, path: Path, row_format: RowFormat, head: Head, rows: list[str], blocks: Iterable[list[str]]
    ) -> RawCloud:
        """Reads a table without column names; `rows` are the first of its `blocks`.

        Raises:
            ScanError: see `read`.
        """
        sample_rows = max(min(SAMPLE_ROWS, _MAX_SAMPLE_CELLS // row_format.width), _MIN_SAMPLE_ROWS)
        sample = row_format.table(rows[:sample_rows])
        refuse_other_tables(sample, path.stat().st_size // (len(rows[0]) + 1))
        fields = self._unnamed_fields(row_format, sample, path)
        scans = _read_table(path, fields.apply_to(row_format), head, blocks, self.max_rows)
        _check_counts(path, head, scans)
        note = scans.note
        if row_format.width > 3 and scans.are_numbered:
            row_format = replace(row_format, xyz_columns=(1, 2, 3))
            fields = self._unnamed_fields(row_format, sample, path)
            scans = _read_table(path, fields.apply_to(row_format), head, _reread_rows(path, head), self.max_rows)
            check_first_columns(scans.points, sample[:, 1:], 2)
            note = _join_notes(_row_index_note(row_format.width), scans.note)
        else:
            check_first_columns(scans.points, sample)
        return fields.fill(RawCloud(scans.points, total=scans.total, note=note), scans.values)

    def _unnamed_fields(self, row_format: RowFormat, sample: np.ndarray, path: Path) -> TextFields:
        return unnamed_fields(row_format, sample, path.suffix.lower(), self.wants)

    def _detect_row_format(self, path: Path, head: Head, rows: list[str]) -> RowFormat:
        """Detects the format of the rows from the first ones.

        Raises:
            ScanError: see `read`.
        """
        try:
            return detect_row_format(rows, head, self.columns)
        except ScanError as error:
            raise ScanError(f"line {line_number(path, head.lines)}: {notation_message(rows[:2]) or error}"
                            f"{truncation_hint(path, head.lines)}") from error


@dataclass
class _TableScans:
    """The rows of all scans in a table, one after the other."""

    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    values: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    """The further columns (N, M) that are read."""
    counts: list[int] = field(default_factory=lambda: [0])
    """The number of points of each scan."""
    promised: list[tuple[str, int]] = field(default_factory=list)
    """For each scan but the first, the number of its points as written in the file, and the index of that line."""

    is_thinned: bool = False
    """Whether `points` are a subsample of the rows."""
    are_numbered: bool = False
    """Whether the first column counts the rows from 0 or 1."""

    @property
    def total(self) -> int | None:
        """The number of rows, if the points are a subsample of them."""
        return sum(self.counts) if self.is_thinned else None

    @property
    def note(self) -> str:
        """The note for the user if there are several scans."""
        return f"{len(self.counts)} scans in one file" if len(self.counts) > 1 else ""


def _named_cloud(scans: _TableScans, head: Head, path: Path) -> RawCloud:
    """The cloud of a table with named columns; names in the file may declare depths, degrees, heights or COLMAP."""
    points, notes = scans.points, [scans.note]
    if head.depth:
        positive = bool(np.nanmedian(points[:, 2]) > 0) if np.isfinite(points[:, 2]).any() else False
        points = points * [1, 1, -1] if positive else points
        notes.append("depths count down, so z = -depth" if positive else "depths below 0 are taken as heights")
    if head.degrees:
        points, degrees_note = project_degrees(points)
        notes.append(degrees_note)
    if head.colmap:
        colmap = import_lazily("z2p_renderer.plugins.readers._cameras.colmap")
        cloud: RawCloud = colmap.with_colmap_cameras(points, path, _join_notes(*notes))
        return cloud
    if head.heights:
        return RawCloud(points, note=_join_notes(*notes), up="+Z", up_reason="z is a height by its columns' names")
    return RawCloud(points, note=_join_notes(*notes))


def _is_bare_colmap(path: Path, head: Head, rows: list[str]) -> bool:
    """Whether this is COLMAP's list of points by its file name, although no comment names its columns."""
    if path.stem.lower() != "points3d" or head.names:
        return False
    return min(len(row.split()) for row in rows[:SAMPLE_ROWS]) >= 8


def _join_notes(*notes: str) -> str:
    return "; ".join(filter(None, notes))


def _row_index_note(width: int) -> str:
    names = example_column_names(width)
    return f"column 1 counts the rows, so x y z are columns 2 to 4; --columns {names} takes it as x"


def _check_counts(path: Path, head: Head, scans: _TableScans) -> None:
    """Raises ScanError if a scan has another number of points than its line says; the first may give the total."""
    if head.promised is None or (scans.promised and head.promised == str(sum(scans.counts))):
        return
    promises = [(head.promised, head.promised_at), *scans.promised]
    for (promised, line_index), count in zip(promises, scans.counts, strict=True):
        if promised.strip() != str(count):
            raise ScanError(f"line {line_number(path, line_index)} promises {promised.strip()[:40]!r} points, {count} "
                            "came; mend the number, take the line out, or export the file again")


def _reread_rows(path: Path, head: Head) -> Iterable[list[str]]:
    """Reads the blocks of rows of a file once more."""
    blocks = content_blocks(path)
    first: list[str] = next(blocks, [])
    return chain([first[head.lines :] or next(blocks, [])], blocks)


def _read_table(
    path: Path, row_format: RowFormat, head: Head, blocks: Iterable[list[str]], max_rows: int
) -> _TableScans:
    """Parses blocks of rows, between which lines may hold the number of points of the next scan.

    Of very many rows some are kept. The others are parsed only where they may be such lines.
    """
    scans, before, index = _TableScans(), head.lines, RowIndex()
    columns = 3 + len(row_format.field_columns) + row_format.list_lengths
    thinned = ThinnedRows(columns, max_rows, estimate_lines(path))
    several = head.promised is not None and (not row_format.named or path.suffix.lower() == ".pts")
    for rows in blocks:
        chosen = None if several else thinned.choose(len(rows))
        try:
            points = [_parse_rows(row_format, rows, chosen)]
            scans.counts[-1] += len(rows)
        except BadLineError as error:
            if not several or not any(map(is_count, rows)):
                raise _bad_line_error(error, row_format, rows, path, before) from error
            points = _split_scans(path, row_format, rows, before, scans)
        for part in points:
            index.follow(part[:, 0], chosen, len(part) if chosen is None else len(rows))
            (thinned.add if chosen is None else thinned.keep)(part)
        before += len(rows)
    table, scans.is_thinned, scans.are_numbered = thinned.table(), thinned.is_thinned, index.counts_rows
    scans.points, scans.values = (table, table[:, 3:]) if table.shape[1] == 3 else (table[:, :3].copy(), table[:, 3:])
    return scans


def _parse_rows(row_format: RowFormat, rows: list[str], chosen: np.ndarray | None) -> np.ndarray:
    """The numbers (N, C) of the chosen rows, or of all.

    Raises:
        BadLineError: with the index among all rows.
    """
    if chosen is None:
        return row_format.numbers(rows)
    try:
        return row_format.numbers([rows[index] for index in chosen.tolist()])
    except BadLineError:
        row_format.numbers(rows)
        raise


def _split_scans(
    path: Path, row_format: RowFormat, rows: list[str], before: int, scans: _TableScans
) -> list[np.ndarray]:
    """Parses rows between lines that hold the number of points of the next scan; updates `scans`."""
    marks = [index for index, row in enumerate(rows) if is_count(row)]
    parts = []
    for start, end in zip([0, *(mark + 1 for mark in marks)], [*marks, len(rows)], strict=True):
        if start:
            scans.promised.append((rows[start - 1], before + start - 1))
            scans.counts.append(0)
        if start < end:
            try:
                parts.append(row_format.numbers(rows[start:end]))
            except BadLineError as error:
                raise _bad_line_error(error, row_format, rows[start:end], path, before + start) from error
            scans.counts[-1] += end - start
    return parts


def _bad_line_error(error: BadLineError, row_format: RowFormat, lines: list[str], path: Path, before: int) -> ScanError:
    """The error for a bad line among `lines`, which follow `before` content lines of the file."""
    index = before + error.index
    if note := notation_message(lines[error.index : error.index + 2]):
        return ScanError(f"line {line_number(path, index)}: {note}")
    title = lines[0]
    if index == 0 and not is_row(title):
        return ScanError(f"line {line_number(path, 0)}: expected points, or names of columns with x, y and z once "
                         f"each, got {title.strip()[:60]!r}; name all columns, as in --columns x,y,z,label"
                         f"{missing_height_hint(title)}")
    hint = "" if row_format.named else "; where columns hold words, name all of them, as in --columns x,y,z,label"
    return ScanError(f"expected the same count of numbers on every line, but in line {line_number(path, index)} "
                     f"{error}; put '#' before lines that are no points{hint}{truncation_hint(path, index)}")
