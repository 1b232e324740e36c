"""Tables of figures on disk: which cloud or picture stands in which cell, as TOML or CSV."""

from __future__ import annotations

import csv
import io
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from z2p_core.interfaces import SettingError
from z2p_renderer.storage.files.printable_names import printable

TABLE_SUFFIXES = (".toml", ".csv")
MAX_TABLE_BYTES = 1 << 20
MAX_CELLS = 1000
"""Cells of a table at most."""
_NUMBERED = re.compile(r"(.+)#(\d+)")


@dataclass(frozen=True)
class FigureCell:
    """What stands in a cell."""

    path: Path
    """A scan or a picture; relative to the working folder."""
    cloud: int = 0
    """Which cloud of the file, from 0 on."""


@dataclass(frozen=True)
class FigureTable:
    """Cells in rows and columns with their titles."""

    columns: tuple[str, ...]
    """Titles; empty ones are not drawn."""
    rows: tuple[str, ...]
    cells: tuple[tuple[FigureCell | None, ...], ...]
    """Rows of cells; None for an empty one."""
    shapes_in: str = "rows"
    """``rows`` if each row shows one shape, by one method in each column; ``columns`` if each column does."""

    def shape_of(self, row: int, column: int) -> int:
        """Number of the shape of a cell."""
        return row if self.shapes_in == "rows" else column


def read_figure_table(path: Path) -> FigureTable:
    """The table in a TOML or CSV file; paths in it are relative to that file.

    A CSV's first line holds the titles of the columns, behind a first field that is left out; each further line a row's
    title and its cells. A TOML has ``columns`` (titles) and ``[[rows]]`` with ``title`` and ``cells``, and may have
    ``shapes_in``. A cell is a path, or ``path#3`` for the third cloud of a file; empty for none.

    Raises:
        SettingError: the file is missing or no such table.
    """
    where = printable(path)
    if path.suffix.lower() not in TABLE_SUFFIXES:
        raise SettingError(f"{where}: expected a table named .toml or .csv")
    try:
        content = path.read_bytes()[: MAX_TABLE_BYTES + 1]
        text = content.decode("utf-8-sig")
    except OSError as error:
        raise SettingError(f"{where}: {error.strerror or error}; expected a table of a figure") from error
    except UnicodeDecodeError:
        raise SettingError(f"{where}: expected a text in UTF-8") from None
    if len(content) > MAX_TABLE_BYTES:
        raise SettingError(f"{where}: expected a table of at most {MAX_TABLE_BYTES} bytes")
    columns, rows, shapes_in = _parse_toml(text, where) if path.suffix.lower() == ".toml" else _parse_csv(text, where)
    return _build_table(columns, rows, shapes_in, path.parent, where)


def _parse_csv(text: str, where: str) -> tuple[list[str], list[tuple[str, list[str]]], str]:
    lines = [line for line in csv.reader(io.StringIO(text)) if any(field.strip() for field in line)]
    if len(lines) < 2 or len(lines[0]) < 2:
        raise SettingError(f"{where}: expected a line of titles, as ',Input,Ours', and lines of a title and paths")
    return lines[0][1:], [(line[0], line[1:]) for line in lines[1:]], "rows"


def _parse_toml(text: str, where: str) -> tuple[list[str], list[tuple[str, list[str]]], str]:
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SettingError(f"{where}: no valid TOML: {error}") from None
    unknown = sorted(set(data) - {"columns", "rows", "shapes_in"})
    if unknown:
        raise SettingError(f"{where}: expected columns, rows and shapes_in, got {unknown[0]!r}")
    columns, rows = data.get("columns", []), data.get("rows", [])
    if not (_are_texts(columns) and isinstance(rows, list) and rows and all(isinstance(row, dict) for row in rows)):
        raise SettingError(f"{where}: expected columns as a list of titles, and [[rows]] each with title and cells")
    for number, row in enumerate(rows):
        has_texts = _are_texts(row.get("cells")) and isinstance(row.get("title", ""), str)
        if set(row) - {"title", "cells"} or not has_texts:
            raise SettingError(f"{where}: row {number + 1}: expected title, a text, and cells, a list of paths")
    shapes_in = data.get("shapes_in", "rows")
    if shapes_in not in ("rows", "columns"):
        raise SettingError(f"{where}: expected shapes_in 'rows' or 'columns', got {shapes_in!r}")
    return columns, [(row.get("title", ""), row["cells"]) for row in rows], shapes_in


def _are_texts(values: Any) -> bool:
    return isinstance(values, list) and all(isinstance(value, str) for value in values)


def _build_table(
    columns: list[str], rows: list[tuple[str, list[str]]], shapes_in: str, folder: Path, where: str
) -> FigureTable:  # fmt: skip
    width = max(len(columns), *(len(cells) for _, cells in rows))
    for number, (_, cells) in enumerate(rows):
        if columns and len(cells) > len(columns):
            raise SettingError(f"{where}: row {number + 1} has {len(cells)} cells, but there are {len(columns)} titles "
                               "of columns")
    if not 0 < width * len(rows) <= MAX_CELLS:
        raise SettingError(f"{where}: expected 1 to {MAX_CELLS} cells, got {width * len(rows)}")
    full = [[*given, *[""] * (width - len(given))] for _, given in rows]
    parsed = tuple(tuple(_parse_cell(text, folder) for text in line) for line in full)
    if not any(any(row) for row in parsed):
        raise SettingError(f"{where}: all of its cells are empty")
    titles = tuple(title.strip() for title in [*columns, *[""] * (width - len(columns))])
    return FigureTable(titles, tuple(title.strip() for title, _ in rows), parsed, shapes_in)


def _parse_cell(text: str, folder: Path) -> FigureCell | None:
    text = text.strip()
    if not text:
        return None
    numbered = _NUMBERED.fullmatch(text)
    if numbered and not (folder / text).exists():
        return FigureCell(folder / numbered[1], max(int(numbered[2]) - 1, 0))
    return FigureCell(folder / text)
