"""Points of a PTX file, in which laser scanners export whole scans, one line per cell of the scan grid."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from z2p_core.interfaces import RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.color_note import IGNORED_NOTE
from z2p_renderer.plugins.readers._text.memory_need import memory_of_lines

_NUMBERS_PER_HEADER_LINE = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)
"""Header of a scan: columns and rows of its grid, the scanner's position and axes, and a 4 x 4 matrix."""
_NUMBERS_PER_COLORED_CELL = 7
"""A cell holds x, y, z, intensity, and perhaps r, g, b."""
_BLOCK_LINES = 200_000
"""Lines that are read at a time, so that a large file is never in memory as a whole."""


class Ptx(Reader):
    """Text: scans one after the other, each with a header and columns x rows lines of x y z intensity (r g b)."""

    name = "ptx"
    version = "1"
    takes_columns = False
    suffixes = (".ptx",)

    def memory(self, path: Path) -> int:
        """An estimate from the first lines; the text is read in blocks."""
        return memory_of_lines(path)

    def read(self, path: Path) -> list[RawCloud]:
        """All scans of the file in its common axes, one cloud (N, 3) float64; cells that measured nothing are left out.

        Raises:
            ScanError: a header of another form, a scan that is cut short, or something not a number.
        """
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            points = np.concatenate([np.empty((0, 3)), *_iter_point_blocks(file)])
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            first = next(islice(file, len(_NUMBERS_PER_HEADER_LINE), None), "")
        return [RawCloud(points, note=IGNORED_NOTE if len(first.split()) == _NUMBERS_PER_COLORED_CELL else "")]


def _iter_point_blocks(file: TextIO) -> Iterator[np.ndarray]:
    """Blocks of points (N, 3) of all scans, transformed by each scan's matrix."""
    line = 0
    while header := _read_header(file, line):
        line += len(_NUMBERS_PER_HEADER_LINE)
        cells = int(header[0][0]) * int(header[1][0])
        matrix = np.array(header[6:])
        for start in range(0, cells, _BLOCK_LINES):
            expected = min(_BLOCK_LINES, cells - start)
            rows = list(islice(file, expected))
            points = _parse_points(rows, line)
            line += len(rows)
            if len(points) < expected:
                raise ScanError(f"a scan of {header[0][0]:g} x {header[1][0]:g} cells ends in line {line}, after "
                                f"{start + len(points)}; the file is cut short: export it again")
            measured = points[points.any(1)]
            yield measured @ matrix[:3, :3] + matrix[3, :3]  # points are row vectors: the last row is the translation


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


def _parse_points(rows: list[str], first_line: int) -> np.ndarray:
    """Parses x, y and z (N, 3) float64 of the rows behind the first `first_line` lines of the file.

    Raises:
        ScanError: a row has other columns.
    """
    try:
        if not any(map(str.strip, rows)):
            return np.empty((0, 3))
        return np.loadtxt(rows, np.float64, comments=None, usecols=(0, 1, 2), ndmin=2)
    except ValueError as error:
        for number, row in enumerate(rows, start=first_line + 1):
            try:
                np.loadtxt([row], np.float64, comments=None, usecols=(0, 1, 2))
            except ValueError:
                raise ScanError(f"line {number}: expected x y z intensity, got {row.strip()[:40]!r}; "
                                "export the file again") from error
        raise ScanError(f"lines from {first_line + 1} on: {error}; export the file again") from error
