"""Points of a text file: xyz, xyzn, xyzrgb and pts with the columns that Open3D gives them, and txt, asc and csv."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from plugins.readers.text_form import BadLineError, Form, Head, form_of, head_of, some_names
from z2p_core.column_names import text_encoding
from z2p_core.interfaces import MEMORY_A_POINT, RawCloud, Reader, ScanError

_HEAD = 1 << 16
"""Bytes from which the length of a line is told."""
_LINES = 200_000
"""Lines that are read at a time, so that the text of a large file is never in memory as a whole."""
_FIRST_LINES = 5000
"""Lines from which the form of the rows is told."""

_FEWEST_NUMBERED = 10
"""Rows from which a column of 0, 1, 2 ... is no chance."""


class Text(Reader):
    """Plain text, a point a line, numbers parted by blanks, commas or semicolons; ``#`` begins a comment."""

    name = "text"
    version = "4"
    suffixes = (".xyz", ".xyzn", ".xyzrgb", ".pts", ".txt", ".asc", ".csv")

    def memory(self, path: Path) -> int:
        """As many points as the first lines let expect; the text itself is read in parts."""
        with path.open("rb") as file:
            head = file.read(_HEAD)
        lines = head.count(b"\n")
        if lines < 2:  # one endless line would be in memory as a whole
            return super().memory(path)
        return path.stat().st_size * lines // len(head) * MEMORY_A_POINT

    def read(self, path: Path) -> list[np.ndarray | RawCloud]:
        """The first three columns, or those called x, y, z, one cloud (N, 3) float64; an empty cell is NaN.

        Where nobody names the columns and the first of four or more counts the rows, it is no x: the next three are.

        A line before the rows may hold their count, as in every .pts. .txt, .asc and .csv may have further columns, and
        begin with a line of names, among them x, y and z; the columns beside those three may then hold words.

        Raises:
            ScanError: other columns than the suffix stands for or the user named, something not a number, or a wrong
                count.
        """
        head, form = self._form(path)
        points = _table(path, form, head.lines) if form else np.empty((0, 3))
        if head.promised is not None and head.promised != str(len(points)):
            raise ScanError(f"line {_line_number(path, head.promised_at)} promises {head.promised[:40]!r} points, "
                            f"{len(points)} came; mend the number, take the line out, or export the file again")
        if form and form.may_be_numbered and _counts(points[:, 0]):
            numbered = replace(form, places=(1, 2, 3))
            return [RawCloud(_table(path, numbered, head.lines), note=_told_numbers(form.width))]
        return [points]

    def _form(self, path: Path) -> tuple[Head, Form | None]:
        """What stands before the rows, and how they are written; None if there are none.

        Raises:
            ScanError: as `read` says.
        """
        suffix = path.suffix.lower()
        blocks = _content(path, _FIRST_LINES)
        lines = next(blocks, [])
        head = head_of(lines, suffix, self.columns is not None)
        rows = lines[head.lines :] or next(blocks, [])
        if not rows:
            return head, None
        try:
            return head, form_of(rows, head, suffix, self.columns)
        except ScanError as error:
            raise ScanError(f"line {_line_number(path, head.lines)}: {error}") from error


def _counts(column: np.ndarray) -> bool:
    """Whether a column numbers its rows, from 0 or 1 on."""
    return len(column) >= _FEWEST_NUMBERED and column[0] in (0, 1) and bool((np.diff(column) == 1).all())


def _told_numbers(width: int) -> str:
    return f"column 1 counts the rows, so x y z are columns 2 to 4; --columns {some_names(width)} takes it as x"


def _table(path: Path, form: Form, skipped: int) -> np.ndarray:
    """Points (N, 3) of a file whose first `skipped` lines with content are no rows."""
    parts = [np.empty((0, 3))]
    before = 0
    for lines in _content(path, _LINES):
        rows = lines[max(skipped - before, 0) :]
        before += len(lines)
        if rows:
            parts.append(_points(form, rows, path, before - len(rows)))
    return np.concatenate(parts)


def _points(form: Form, lines: list[str], path: Path, before: int) -> np.ndarray:
    """Points (N, 3) of lines that have `before` others with content before them in the file."""
    try:
        return form.points(lines)
    except BadLineError as error:
        hint = "" if form.named else "; where columns hold words, name all of them, as in --columns x,y,z,label"
        raise ScanError(f"expected the same count of numbers on every line, but in line "
                        f"{_line_number(path, before + error.index)} {error}; put '#' before lines that are no points"
                        f"{hint}") from error


def _content(path: Path, count: int) -> Iterator[list[str]]:
    """Lines that hold something, without what ``#`` begins; of so many at a time."""
    with _opened(path) as file:
        while lines := list(islice(file, count)):
            if any("#" in line for line in lines):
                lines = [line.split("#", 1)[0] for line in lines]
            if lines := [line for line in lines if line and not line.isspace()]:
                yield lines


def _opened(path: Path) -> TextIO:
    with path.open("rb") as file:
        encoding = text_encoding(file.read(4))
    return path.open(encoding=encoding, errors="replace")


def _line_number(path: Path, index: int) -> int:
    """Where an editor shows the line that has `index` others with content before it: the first line is 1.

    The file is read again for it, which costs only those that are refused; to remember it would cost all.
    """
    with _opened(path) as file:
        numbers = (number for number, line in enumerate(file, start=1) if line.split("#", 1)[0].strip())
        return next(islice(numbers, index, None))
