"""Parses the head of a text file: comments, the number of rows, column names and units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from z2p_core.formats.tables.header_lines import (
    column_names,
    is_comment,
    is_count,
    is_number,
    is_row,
    is_units,
    names_degrees,
    names_depth,
    names_heights,
    only_numbers_columns,
)

_ATOM_NAME = re.compile(r"[A-Z][A-Za-z]{0,2}\d*")
"""Name of an atom in an .xyz file of chemistry."""
_LIST_COLUMN = re.compile(r"\w\[\]")
"""Name of a column that holds a list of numbers, as in COLMAP's ``TRACK[]``."""
_COLMAP_COLUMNS, _COLMAP_ID_COLUMN = ("point3d_id", "x", "y", "z", "r", "g", "b", "error"), "point3d_id"


@dataclass
class Head:
    """The lines before the rows; `names` are the possible readings of the line of names."""

    lines: int = 0
    promised: str | None = None
    """The number of points on a line of its own, as written in the file; None if there is no such line."""
    promised_at: int = 0
    """Index of that line."""
    names: Sequence[tuple[str, ...]] = ()
    title: str = ""
    """The line of names, known or not."""
    optional: bool = False
    """Whether the names come from a comment, which may mean something else."""
    ragged: bool = False
    """Whether rows may hold a list of any length behind the named columns."""
    colmap: bool = False
    """Whether this is COLMAP's list of points."""

    @property
    def degrees(self) -> bool:
        """Whether x and y are longitude and latitude by their names."""
        return names_degrees(self.title)

    @property
    def heights(self) -> bool:
        """Whether z points up by the columns' names."""
        return names_heights(self.title)

    @property
    def depth(self) -> bool:
        """Whether z is a depth by its name."""
        return names_depth(self.title)


def parse_head(lines: list[str], suffix: str, named: bool) -> Head:
    """Parses the lines before the rows; `named` says that the user names the columns."""
    head = Head()
    while head.lines < len(lines) and is_comment(lines[head.lines]):
        if names := column_names(lines[head.lines]):
            head.names, head.title, head.optional = names, lines[head.lines], True
        head.lines += 1
    _parse_count(lines, suffix, head)
    if head.promised is not None:
        _parse_molecule(lines, head)
    rest = lines[head.lines : head.lines + 1]
    names = column_names(rest[0]) if rest else []
    if names or (rest and named and not is_row(rest[0])):
        head.names, head.title, head.optional = names, rest[0], False
        head.lines += 1
        _parse_count(lines, suffix, head)
    elif len(lines) > head.lines + 1 and only_numbers_columns(*lines[head.lines : head.lines + 2]):
        head.lines += 1
    if head.title and any(map(is_units, lines[head.lines : head.lines + 1])):
        head.lines += 1
    head.colmap = any(_COLMAP_ID_COLUMN in names for names in head.names)
    head.ragged = head.optional and _LIST_COLUMN.search(head.title) is not None
    return head


def as_colmap(head: Head) -> Head:
    """The head of COLMAP's list of points whose comments were removed."""
    return replace(head, names=[_COLMAP_COLUMNS], title=",".join(_COLMAP_COLUMNS), optional=True, ragged=True,
                   colmap=True)


def _parse_count(lines: list[str], suffix: str, head: Head) -> None:
    """Adds the next line to the head if it holds a number of points alone, or, in a .pts, any single word."""
    for line in lines[head.lines : head.lines + 1]:
        alone = len(re.split(r"[;,\s]+", line.strip())) == 1
        if head.promised is None and (is_count(line) or (suffix == ".pts" and alone)):
            head.promised, head.promised_at = line.strip(), head.lines
            head.lines += 1


def _parse_molecule(lines: list[str], head: Head) -> None:
    """Recognizes an .xyz of chemistry: a comment follows the count, and each row begins with an element."""
    for index, line in enumerate(lines[head.lines : head.lines + 2]):
        words = line.split()
        if len(words) > 3 and _ATOM_NAME.fullmatch(words[0]) and all(map(is_number, words[1:4])):
            head.names = [("element", "x", "y", "z", *[""] * (len(words) - 4))]
            head.lines += index
            return
