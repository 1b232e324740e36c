"""Detects the row format of a text file from its first lines, and parses rows of that format."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from z2p_core.formats.tables.header_lines import is_fortran_number, is_missing, is_number, plain_exponents
from z2p_core.interfaces import ScanError
from z2p_renderer.plugins.readers._text.header import Head

SAMPLE_ROWS = 1000
"""Rows from which the format is detected."""
_COMMA_DECIMAL = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_POINT_DECIMAL = re.compile(r"[+-]?\d*\.\d*([eE][+-]?\d+)?")


class BadLineError(ValueError):
    """A line that is no row of the table; `index` is its index among the given lines."""

    def __init__(self, index: int, reason: str) -> None:
        super().__init__(reason)
        self.index = index


@dataclass(frozen=True)
class RowFormat:
    """Format of a row: `width` cells, of which those at `xyz_columns` are x, y and z."""

    delimiter: str | None
    """None stands for runs of blanks."""
    decimal_commas: bool
    """Whether commas are decimal points."""
    blank_sign: str = ""
    """A further separator that is equivalent to blanks, so that no cell can be empty; "" if there is none."""
    trailing_delimiter: bool = False
    """Whether every row ends with the delimiter."""
    width: int = 0
    xyz_columns: tuple[int, ...] = (0, 1, 2)
    field_columns: tuple[int, ...] = ()
    """Further columns that are read."""
    named: bool = False
    """Whether names say which columns are x, y and z: then the other columns may hold words."""
    names: tuple[str, ...] = ()
    """The names of the columns, if the user or the file gives them."""
    ragged: bool = False
    """Whether rows may hold more cells than `width`: a list behind the columns that count."""
    fortran: bool = False
    """Whether exponents may be written with ``D``."""
    list_lengths: bool = False
    """Whether a last column is wanted that tells how many cells a `ragged` row has behind the others."""

    def numbers(self, lines: list[str]) -> np.ndarray:
        """Parses rows to x, y, z and the further columns (N, 3 or more) float64; an empty cell is NaN.

        A word in a further column is NaN, too, if the columns are named.

        Raises:
            BadLineError: a row has another number of columns than the first one, or a cell holds no number.
        """
        columns = (*self.xyz_columns, *self.field_columns)
        if self.list_lengths:
            plain = replace(self, list_lengths=False)
            return np.column_stack([plain.numbers(lines), [len(self.cells(line)) - self.width for line in lines]])
        only: dict[str, Any] = {"usecols": columns} if self.ragged else {}
        try:  # by far the fastest, but it takes nothing else than numbers
            table = np.loadtxt(self._normalized(lines), np.float64, comments=None, delimiter=self.delimiter, ndmin=2,
                               **only)
        except ValueError:
            return self._row_by_row(lines)
        if self.ragged:
            return table
        if table.shape[1] != self.width:
            return self._row_by_row(lines)
        return table[:, :3].copy() if columns == (0, 1, 2) else table[:, list(columns)]

    def table(self, lines: list[str]) -> np.ndarray:
        """All cells (N, width) float64 of some rows; NaN where a cell holds no number."""
        table = np.full((len(lines), self.width), np.nan)
        for index, line in enumerate(lines):
            for column, cell in enumerate(self.cells(line)[: self.width]):
                table[index, column] = self._number(cell) if self._is_readable(cell) else np.nan
        return table

    def cells(self, line: str) -> list[str]:
        """The cells of a row; a quoted one may hold the delimiter."""
        if self.blank_sign:
            line = line.replace(self.blank_sign, " ")
        if '"' not in line:
            return line.split(self.delimiter)
        line = line.strip("\r\n") if self.delimiter else " ".join(line.split())
        return next(csv.reader([line], delimiter=self.delimiter or " ", skipinitialspace=True))

    def _normalized(self, lines: list[str]) -> list[str]:
        """The lines in the notation that numpy parses."""
        if self.trailing_delimiter and self.delimiter:
            lines = [line.rstrip().removesuffix(self.delimiter) for line in lines]
        if self.decimal_commas:
            lines = [line.replace(",", ".") for line in lines]
        if self.fortran:
            lines = [plain_exponents(line) for line in lines]
        return [line.replace(self.blank_sign, " ") for line in lines] if self.blank_sign else lines

    def _row_by_row(self, lines: list[str]) -> np.ndarray:
        rows = np.empty((len(lines), 3 + len(self.field_columns)))
        xyz_columns = self.xyz_columns if self.named else range(self.width)
        for index, line in enumerate(lines):
            cells = self.cells(line)
            if len(cells) == self.width + 1 and not cells[-1].strip():
                del cells[-1]
            if len(cells) < self.width or (len(cells) > self.width and not self.ragged):
                raise BadLineError(index, f"the number of columns changed from {self.width} to {len(cells)}")
            try:
                numbers = {column: self._number(cells[column]) for column in xyz_columns}
                rows[index, :3] = [numbers[column] for column in self.xyz_columns]
                rows[index, 3:] = [self._number(cells[column]) if self._is_readable(cells[column]) else np.nan
                                   for column in self.field_columns]  # fmt: skip
            except ValueError as error:
                column = next(column for column in xyz_columns if not self._is_readable(cells[column]))
                reason = f"column {column + 1} holds {cells[column].strip()[:40]!r}, which is no number"
                raise BadLineError(index, reason) from error
        return rows

    def _number(self, cell: str) -> float:
        """The number in a cell; NaN if the cell is empty or holds a word for a missing number.

        A comma counts as a decimal point only if commas do not separate cells.
        """
        if self.fortran:
            cell = plain_exponents(cell)
        if not cell or "_" in cell or "," in cell:  # Python would take 1_000 for a number
            cell = cell.strip().replace("_", "?").replace(",", "?" if self.delimiter == "," else ".")
        try:
            return float(cell) if cell and not cell.isspace() else np.nan
        except ValueError:
            if is_missing(cell):
                return np.nan
            raise

    def _is_readable(self, cell: str) -> bool:
        try:
            self._number(cell)
        except ValueError:
            return False
        return True


def detect_row_format(rows: list[str], head: Head, columns: Sequence[str] | None) -> RowFormat:
    """Detects the format from the first rows of a file, at least one; `columns` are the names that the user gives.

    Raises:
        ScanError: there are fewer than three columns, or another number of columns than names.
    """
    sample = rows[:SAMPLE_ROWS]
    delimiter = _delimiter(sample, head.title)
    decimal_commas = delimiter == ";" or (delimiter != "," and any("," in line for line in sample))
    row_format = RowFormat(delimiter, decimal_commas)
    table = [row_format.cells(line) for line in sample]
    if delimiter in (",", ";") and any(_holds_several_numbers(cell) for cells in table for cell in cells):
        row_format = replace(row_format, delimiter=None, blank_sign=delimiter)
        table = [row_format.cells(line) for line in sample]
    fortran = any(is_fortran_number(cell.strip(" \"'")) for cells in table for cell in cells)
    row_format = replace(row_format, fortran=fortran)
    width = len(table[0])
    trailing_delimiter = width > 0 and not any(len(cells) >= width and cells[width - 1].strip() for cells in table)
    ragged = _ragged_names(head, table, columns)
    if ragged is not None:
        xyz_columns = tuple(ragged.index(axis) for axis in "xyz")
        return replace(row_format, width=len(ragged), xyz_columns=xyz_columns, named=True, names=ragged, ragged=True)
    if not columns and _have_row_names(sample, table):
        head = replace(head, names=[*head.names, *(("", *names) for names in head.names)])
    names = _matching_names(head, width, trailing_delimiter, columns)
    if names is None:
        _check_column_count(width - trailing_delimiter)
        return replace(row_format, width=width - trailing_delimiter, trailing_delimiter=trailing_delimiter)
    xyz_columns = tuple(names.index(axis) for axis in "xyz")
    return replace(row_format, width=len(names), trailing_delimiter=len(names) < width, xyz_columns=xyz_columns,
                   named=True, names=tuple(names))  # fmt: skip


def _ragged_names(head: Head, table: list[list[str]], columns: Sequence[str] | None) -> tuple[str, ...] | None:
    """Names of the columns before a list of varying length at the end of each row; None if rows have one length.

    Only names from the user or from a comment allow such a list; other names must fit every row.
    """
    shortest, longest = min(map(len, table)), max(map(len, table))
    if columns:
        candidates = [tuple(columns)] if shortest < longest else []
    else:
        candidates = list(head.names) if head.optional and (head.ragged or shortest < longest) else []
    for names in candidates:
        last = max(names.index(axis) for axis in "xyz")
        if last < shortest and (longest > len(names) or head.ragged):
            return names[: max(min(shortest, len(names) - 1), last + 1)]
    return None


def _delimiter(sample: list[str], title: str) -> str | None:
    """The delimiter between cells; None for blanks."""
    if ";" in sample[0]:
        return ";"
    if "," not in title and _has_cells_between_tabs(sample, title):
        return "\t"
    if any("," in line for line in sample) and not all(map(_uses_decimal_commas, sample)):
        return ","
    return None


def _has_cells_between_tabs(sample: list[str], title: str) -> bool:
    """Whether tabs separate as many cells as names, some empty or with blanks inside, so that blanks cannot."""
    tabs, words = title.count("\t"), len(title.split())
    return (tabs > 1 and all(line.count("\t") == tabs for line in sample)
            and any(len(line.split()) != words for line in sample))  # fmt: skip


def _uses_decimal_commas(line: str) -> bool:
    """Whether blanks separate numbers in which every comma can only be a decimal point: ``0,5 1,25 0``."""
    fields = line.split()
    return len(fields) > 2 and all(
        _COMMA_DECIMAL.fullmatch(field) if "," in field else not _POINT_DECIMAL.fullmatch(field) for field in fields
    )


def _holds_several_numbers(cell: str) -> bool:
    parts = cell.split()
    return len(parts) > 1 and all(map(is_number, parts))


def _have_row_names(sample: list[str], table: list[list[str]]) -> bool:
    """Whether each row begins with a row name, as R writes it without a title: a word or an index, perhaps quoted."""
    firsts = [cells[0].strip() for cells in table if cells]
    if all(line.lstrip().startswith('"') for line in sample) or not any(map(is_number, firsts)):
        return True
    return len(firsts) > 1 and firsts == [str(number) for number in range(1, len(firsts) + 1)]


def _matching_names(
    head: Head, width: int, trailing_delimiter: bool, columns: Sequence[str] | None
) -> Sequence[str] | None:
    """Names of the columns from the user or the file, if their number fits; None if there are no names.

    Raises:
        ScanError: names that must hold do not fit the number of columns.
    """
    candidates = [tuple(columns)] if columns else head.names
    for names in candidates:
        for shorter in (False, True):  # a delimiter may end every row, or the line of names alone
            cut = names[:-1] if shorter and not names[-1] else names
            if len(cut) == width or (trailing_delimiter and len(cut) == width - 1):
                return cut
    if not candidates or (head.optional and not columns):
        return None
    raise ScanError(f"--columns or the file's first line names {len(candidates[0])} columns "
                    f"({','.join(candidates[0])}), the file has {width - trailing_delimiter}; name each of them, in "
                    "their order, as in --columns x,y,z,i")


def _check_column_count(columns: int) -> None:
    if columns < 3:
        raise ScanError(f"expected x y z and perhaps more on a line, got {columns} "
                        f"column{'' if columns == 1 else 's'}; part them by blanks, commas or semicolons, and put '#' "
                        "before lines that are no points")
