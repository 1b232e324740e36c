"""Points of a text file: xyz, xyzn, xyzrgb and pts with the columns that Open3D gives them, and txt, asc and csv."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import TextIO

import numpy as np

from z2p_core.column_names import column_names, is_row, text_encoding, without_comment
from z2p_core.interfaces import RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers.text_form import TABLES, BadLineError, Form, Head, form_of, head_of, some_names
from z2p_renderer.plugins.readers.text_lines import memory_of_lines

_LINES = 200_000
"""Lines that are read at a time, so that the text of a large file is never in memory as a whole."""
_FIRST_LINES = 5000
"""Lines from which the form of the rows is told."""
_DEGREES = {"lat", "latitude", "lon", "long", "lng", "longitude"}
"""Names of columns that hold degrees."""
_FEWEST_NUMBERED = 10
"""Rows from which a column of 0, 1, 2 ... is no chance."""


class Text(Reader):
    """Plain text, a point a line, numbers parted by blanks, commas or semicolons; ``#`` begins a comment."""

    name = "text"
    version = "6"
    suffixes = (".xyz", ".xyzn", ".xyzrgb", ".pts", ".txt", ".asc", ".csv")

    def memory(self, path: Path) -> int:
        """As many points as the first lines let expect; the text itself is read in parts."""
        return memory_of_lines(path)

    def read(self, path: Path) -> list[np.ndarray | RawCloud]:
        """The first three columns, or those called x, y, z, one cloud (N, 3) float64; an empty cell is NaN.

        Where nobody names the columns and the first of four or more counts the rows, it is no x: the next three are.

        A line before the rows may hold their count, as in every .pts. There may be a line of names, among them x, y and
        z; the columns beside those three may then hold words. .txt, .asc and .csv may have further columns without.

        Raises:
            ScanError: other columns than the suffix stands for or the user named, something not a number, or a wrong
                count.
        """
        blocks = _content(path)
        first = next(blocks, [])
        head = head_of(first, path.suffix.lower(), self.columns is not None)
        rows = first[head.lines :] or next(blocks, [])
        form = self._form(path, head, rows) if rows else None
        points = _table(path, form, head.lines, chain([rows], blocks)) if form else np.empty((0, 3))
        if head.promised is not None and head.promised != str(len(points)):
            raise ScanError(f"line {_line_number(path, head.promised_at)} promises {head.promised[:40]!r} points, "
                            f"{len(points)} came; mend the number, take the line out, or export the file again")
        if form and form.may_be_numbered and _counts(points[:, 0]):
            numbered = replace(form, places=(1, 2, 3))
            return [RawCloud(_again(path, numbered, head.lines), note=_told_numbers(form.width))]
        return [points]

    def _form(self, path: Path, head: Head, rows: list[str]) -> Form:
        """How the rows, of which these are the first, are written.

        Raises:
            ScanError: as `read` says.
        """
        try:
            return form_of(rows, head, path.suffix.lower(), self.columns)
        except ScanError as error:
            raise ScanError(f"line {_line_number(path, head.lines)}: {error}{_told_cut(path, head.lines)}") from error


def _counts(column: np.ndarray) -> bool:
    """Whether a column numbers its rows, from 0 or 1 on."""
    return len(column) >= _FEWEST_NUMBERED and column[0] in (0, 1) and bool((np.diff(column) == 1).all())


def _told_numbers(width: int) -> str:
    return f"column 1 counts the rows, so x y z are columns 2 to 4; --columns {some_names(width)} takes it as x"


def _table(path: Path, form: Form, before: int, blocks: Iterable[list[str]]) -> np.ndarray:
    """Points (N, 3) of blocks of rows, before which so many lines of the file have content but are none."""
    parts = [np.empty((0, 3))]
    for rows in blocks:
        parts.append(_points(form, rows, path, before))
        before += len(rows)
    return np.concatenate(parts)


def _again(path: Path, form: Form, skipped: int) -> np.ndarray:
    """Points (N, 3) of the file, read once more, whose first `skipped` lines with content are no rows."""
    blocks = _content(path)
    first = next(blocks, [])
    return _table(path, form, skipped, chain([first[skipped:] or next(blocks, [])], blocks))


def _points(form: Form, lines: list[str], path: Path, before: int) -> np.ndarray:
    """Points (N, 3) of lines that have `before` others with content before them in the file."""
    try:
        return form.points(lines)
    except BadLineError as error:
        if path.suffix.lower() in TABLES and before + error.index == 0 and not is_row(line := lines[0]):
            raise ScanError(f"line {_line_number(path, 0)}: expected points, or names of columns with x, y and z once "
                            f"each, got {line.strip()[:60]!r}; name all columns, as in --columns x,y,z,label"
                            f"{_told_degrees(line)}") from error
        hint = "" if form.named else "; where columns hold words, name all of them, as in --columns x,y,z,label"
        index = before + error.index
        raise ScanError(f"expected the same count of numbers on every line, but in line {_line_number(path, index)} "
                        f"{error}; put '#' before lines that are no points{hint}{_told_cut(path, index)}") from error


def _told_degrees(title: str) -> str:
    """What to say of a line that names latitude and longitude."""
    if not _DEGREES & set(re.split(r"[^a-z]+", title.lower())):
        return ""
    return "; degrees are no lengths: project them to metres first, to UTM for one"


def _content(path: Path) -> Iterator[list[str]]:
    """Lines that hold something, without what ``#`` begins; some first ones, then many at a time."""
    with _opened(path) as file:
        lines = _with_names(list(islice(file, _FIRST_LINES)))
        while lines:
            if "#" in "".join(lines):
                lines = [line.split("#", 1)[0] for line in lines]
            if "" in lines or any(map(str.isspace, lines)):
                lines = [line for line in lines if line and not line.isspace()]
            if lines:
                yield lines
            lines = list(islice(file, _LINES))


def _with_names(first: list[str]) -> list[str]:
    """The first lines of a file, in which one that names columns behind ``#``, as numpy writes it, begins with ``//``.

    So it is kept for `head_of`, which takes it for a comment that may mean something else.
    """
    for index, line in enumerate(first):
        if line.startswith("#"):
            if column_names(names := line.lstrip("#")):
                first[index] = "//" + names
        elif line.strip():
            first[index] = without_comment(line)
            break
    return first


def _opened(path: Path) -> TextIO:
    with path.open("rb") as file:
        encoding = text_encoding(file.read(4))
    return path.open(encoding=encoding, errors="replace")


def _line_number(path: Path, index: int) -> int:
    """Where an editor shows the line that has `index` others with content before it: the first line is 1.

    The file is read again for it, which costs only those that are refused; to remember it would cost all.
    """
    return _line(path, index)[0]


def _told_cut(path: Path, index: int) -> str:
    """What to say of a line that goes on behind ``#``, as a colour would."""
    if "#" not in _line(path, index)[1]:
        return ""
    return "; on that line '#' begins a comment, so the rest of it was not read: take the sign out where it is none"


def _line(path: Path, index: int) -> tuple[int, str]:
    """Number and text of the line that has `index` others with content before it."""
    with _opened(path) as file:
        lines = chain(_with_names(list(islice(file, _FIRST_LINES))), file)
        told = ((number, line) for number, line in enumerate(lines, start=1) if line.split("#", 1)[0].strip())
        return next(islice(told, index, None))
