"""Points of a PTX file, in which laser scanners export whole scans, one line per cell of the scan grid."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from z2p_core.formats.row_subsampling import ThinnedRows
from z2p_core.interfaces import RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.point_fields import plan_fields
from z2p_renderer.plugins.readers._text.memory_need import estimate_lines, memory_of_lines

_NUMBERS_PER_HEADER_LINE = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)
"""Header of a scan: columns and rows of its grid, the scanner's position and axes, and a 4 x 4 matrix."""
_CELL_NAMES = ("x", "y", "z", "intensity", "r", "g", "b")
"""The numbers of a cell; some scanners have no colors, so that the last three are missing."""
_BLOCK_LINES = 200_000
"""Lines that are read at a time, so that a large file is never in memory as a whole."""


class Ptx(Reader):
    """Text: scans one after the other, each with a header and columns x rows lines of x y z intensity (r g b)."""

    name = "ptx"
    version = "2"
    takes_columns = False
    suffixes = (".ptx",)

    def memory(self, path: Path) -> int:
        """An estimate from the first lines; the text is read in blocks."""
        return memory_of_lines(path, self.max_rows)

    def read(self, path: Path) -> list[RawCloud]:
        """All scans of the file in its common axes, one cloud (N, 3) float64; cells that measured nothing are left out.

        Raises:
            ScanError: a header of another form, a scan that is cut short, or something not a number.
        """
        plan = plan_fields(_CELL_NAMES, self.wants, (0, 1, 2))
        thinned, width, total = ThinnedRows(3 + len(plan.columns), self.max_rows, estimate_lines(path)), 0, 0
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            for rows, given, cells in _iter_cells(file, (0, 1, 2, *plan.columns), thinned):
                thinned.keep(rows)
                width, total = max(width, given), total + cells
        whole = thinned.table()
        columns = {column: whole[:, 3 + index] for index, column in enumerate(plan.columns)}
        missing = [name for name, places in plan.columns_of.items() if max(places) >= width]
        cloud = RawCloud(np.ascontiguousarray(whole[:, :3]), total=total if thinned.is_thinned else None)
        return [plan.without(*missing).fill(cloud, columns)]


def _iter_cells(
    file: TextIO, columns: tuple[int, ...], thinned: ThinnedRows
) -> Iterator[tuple[np.ndarray, int, int]]:
    """Blocks of the cells (N, 3 or more) that measured something, the width of their rows, and how many cells each is.

    Only cells that `thinned` chooses are parsed. The first three `columns` are x, y and z, transformed by each scan's
    matrix.
    """
    line = 0
    while header := _read_header(file, line):
        line += len(_NUMBERS_PER_HEADER_LINE)
        cells = int(header[0][0]) * int(header[1][0])
        matrix = np.array(header[6:])
        for start in range(0, cells, _BLOCK_LINES):
            expected = min(_BLOCK_LINES, cells - start)
            lines = list(islice(file, expected))
            width = len(lines[0].split()) if lines else 0
            chosen = thinned.choose(len(lines))
            rows = _parse_cells(lines, line, columns, width, chosen)
            line += len(lines)
            if len(rows) < (expected if chosen is None else -(-len(chosen) * expected // max(len(lines), 1))):
                raise ScanError(f"a scan of {header[0][0]:g} x {header[1][0]:g} cells ends in line {line}, after "
                                f"{start + len(rows)}; the file is cut short: export it again")
            measured = rows[rows[:, :3].any(1)]
            measured[:, :3] = measured[:, :3] @ matrix[:3, :3] + matrix[3, :3]  # points are row vectors
            yield measured, width, expected


def _read_header(file: TextIO, first_line: int) -> list[list[float]]:
    """The numbers on the header lines of the next scan; empty at the end of the file.

    Raises:
        ScanError: the lines are no such header.
    """
    lines = list(islice(file, len(_NUMBERS_PER_HEADER_LINE)))
    if not any(map(str.strip, lines)):
        return []
    try:
        numbers = [[float(word) for word in line.split()] for line in lines]
        valid = tuple(map(len, numbers)) == _NUMBERS_PER_HEADER_LINE
        valid = valid and all(row[0].is_integer() and row[0] >= 0 for row in numbers[:2])
    except ValueError:
        valid = False
    if not valid:
        raise ScanError(f"line {first_line + 1}: expected the header of a scan in ten lines (columns, rows, place, "
                        f"three axes, four rows of a matrix), got {lines[0].strip()[:40]!r}; export the file again, or "
                        "rename it to .txt if it holds rows of x y z")
    return numbers


def _parse_cells(
    rows: list[str], first_line: int, columns: tuple[int, ...], width: int, chosen: np.ndarray | None
) -> np.ndarray:  # fmt: skip
    """Parses `columns` (N, len(columns)) float64 of the rows behind the first `first_line` lines of the file.

    Of the rows only the `chosen` ones are parsed, None for all.

    Columns that the rows of `width` do not have are NaN.

    Raises:
        ScanError: a row has other columns.
    """
    given = tuple(column for column in columns if column < max(width, 3))
    try:
        if not any(map(str.strip, rows)):
            return np.empty((0, len(columns)))
        parsed = rows if chosen is None else [rows[index] for index in chosen.tolist()]
        table = np.loadtxt(parsed, np.float64, comments=None, usecols=given, ndmin=2)
        missing = np.full((len(table), len(columns) - len(given)), np.nan)
        return np.column_stack([table, missing])
    except ValueError as error:
        for number, row in enumerate(rows, start=first_line + 1):
            try:
                np.loadtxt([row], np.float64, comments=None, usecols=given)
            except ValueError:
                raise ScanError(f"line {number}: expected x y z intensity, got {row.strip()[:40]!r}; "
                                "export the file again") from error
        raise ScanError(f"lines from {first_line + 1} on: {error}; export the file again") from error
