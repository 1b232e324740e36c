"""Points of a text file: xyz, xyzn, xyzrgb and pts with the columns that Open3D gives them, and txt, asc and csv."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from z2p_core.interfaces import MEMORY_A_POINT, Reader, ScanError

_COLUMNS = {
    ".xyz": ((3,), "x y z"),
    ".xyzn": ((6,), "x y z nx ny nz"),
    ".xyzrgb": ((6,), "x y z r g b"),
    ".pts": ((3, 4, 6, 7), "x y z [intensity] [r g b]"),
}
_SIX_IN_XYZ = ("; six columns may hold normals or colours: say which with --columns x,y,z,nx,ny,nz or "
               "--columns x,y,z,r,g,b")  # fmt: skip
_NAMED = (".txt", ".asc", ".csv")
"""Suffixes of tables, whose first line may name the columns."""
_HEAD = 1 << 16
"""Bytes from which the length of a line is told."""
_LINES = 200_000
"""Lines that are read at a time, so that the text of a large file is never in memory as a whole."""


class Text(Reader):
    """Plain text, a point a line, numbers parted by blanks or commas; ``#`` begins a comment."""

    name = "text"
    version = "2"
    suffixes = (".xyz", ".xyzn", ".xyzrgb", ".pts", ".txt", ".asc", ".csv")

    def memory(self, path: Path) -> int:
        """As many points as the first lines let expect; the text itself is read in parts."""
        with path.open("rb") as file:
            head = file.read(_HEAD)
        lines = head.count(b"\n")
        if lines < 2:  # one endless line would be in memory as a whole
            return super().memory(path)
        return path.stat().st_size * lines // len(head) * MEMORY_A_POINT

    def read(self, path: Path) -> list[np.ndarray]:
        """The first three columns, or those called x, y, z, one cloud (N, 3) float64.

        A .pts begins with the number of its points; a file that has lost that line is read all the same. .txt, .asc and
        .csv may have further columns, and begin with a line of names, among them x, y and z.

        Raises:
            ScanError: other columns than the suffix stands for or the user named, something not a number, or a wrong
                count in .pts.
        """
        suffix = path.suffix.lower()
        parts: list[np.ndarray] = []
        promised, before, names = None, 0, self.columns
        for lines in _content(path):
            if not before and suffix in _NAMED and (found := _names(lines[0])):
                del lines[0]
                names = names or found
            if not before and suffix == ".pts" and len(lines[0].split()) == 1:
                promised = lines.pop(0).strip()
            table = _numbers(lines, before)
            parts.append(_points(suffix, table, names))
            before += len(lines)
        points = np.concatenate([np.empty((0, 3)), *parts])
        if promised is not None and promised != str(len(points)):
            raise ScanError(f"the first line of the .pts file promises {promised[:40]!r} points, "
                            f"{len(points)} came; mend the number or export the file again")
        return [points]


def _points(suffix: str, table: np.ndarray, names: Sequence[str] | None) -> np.ndarray:
    """x, y and z of a part of the file."""
    if names is None:
        _check_columns(suffix, table)
        return table[:, :3].copy()
    if len(table) == 0:
        return np.empty((0, 3))
    if table.shape[1] != len(names):
        raise ScanError(f"--columns or the file's first line names {len(names)} columns ({','.join(names)}), the file "
                        f"has {table.shape[1]}")
    return table[:, [names.index(axis) for axis in "xyz"]]


def _names(line: str) -> tuple[str, ...]:
    """The columns' names in a first line, lower-case; none if it holds numbers, or not x, y and z once each."""
    names = tuple(word.strip("\"'").lower() for word in line.removeprefix("//").split())
    return names if all(names.count(axis) == 1 for axis in "xyz") else ()


def _content(path: Path) -> Iterator[list[str]]:
    """Lines that hold something, without comments, blanks between the numbers; so many at a time."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        while lines := list(islice(file, _LINES)):
            if any(sign in line for sign in "#,;" for line in lines):
                lines = [_parted(line.split("#", 1)[0]) for line in lines]
            if lines := [line for line in lines if line and not line.isspace()]:
                yield lines


def _parted(line: str) -> str:
    """The line with blanks between its numbers; where semicolons part them, a comma is a decimal point."""
    return line.replace(",", ".").replace(";", " ") if ";" in line else line.replace(",", " ")


def _numbers(lines: list[str], before: int) -> np.ndarray:
    """Table (N, columns) float64 of lines that have `before` others before them."""
    if not lines:
        return np.empty((0, 3))
    try:
        return np.loadtxt(lines, dtype=np.float64, comments=None, ndmin=2)
    except ValueError as error:
        reason, after = str(error).split(";")[0], f", after {before} good ones" if before else ""
        raise ScanError(f"expected the same count of numbers on every line: {reason} (lines with content, "
                        f"counted from 0{after}); put '#' before lines that are no points") from error


def _check_columns(suffix: str, table: np.ndarray) -> None:
    columns = table.shape[1]
    if len(table) == 0:
        return
    if suffix not in _COLUMNS:  # a table
        if columns < 3:
            raise ScanError(f"expected x y z and perhaps more on a line, got {columns} columns")
        return
    allowed, meaning = _COLUMNS[suffix]
    if columns not in allowed:
        hint = _SIX_IN_XYZ if (suffix, columns) == (".xyz", 6) else "; rename it to .txt to use the first three"
        counts = " or ".join(str(count) for count in allowed)
        raise ScanError(f"a {suffix} file has {counts} columns ({meaning}), got {columns}{hint if columns > 3 else ''}")
