"""Tables of figures: what stands in which cell, and one clear line for what is no table."""

from __future__ import annotations

from pathlib import Path

import pytest

from z2p_core.interfaces import SettingError
from z2p_renderer.storage.figure_tables import FigureCell, read_figure_table

TOML = 'columns = ["A", "B"]\nshapes_in = "columns"\n[[rows]]\ntitle = "one"\ncells = ["a.ply", ""]\n'


def written(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text)
    return folder / name


def test_a_csv_has_titles_and_paths(tmp_path: Path) -> None:
    table = read_figure_table(written(tmp_path, "t.csv", "\ufeff,In, Out\n\nfirst,a.ply,b.npz#3\nsecond,,c.png\n"))
    assert table.columns == ("In", "Out") and table.rows == ("first", "second")
    assert table.cells == ((FigureCell(tmp_path / "a.ply"), FigureCell(tmp_path / "b.npz", 2)),
                           (None, FigureCell(tmp_path / "c.png")))  # fmt: skip
    assert table.shape_of(1, 0) == 1


def test_a_toml_may_have_its_shapes_in_columns(tmp_path: Path) -> None:
    table = read_figure_table(written(tmp_path, "t.toml", TOML))
    assert table.cells == ((FigureCell(tmp_path / "a.ply"), None),)
    assert table.shape_of(0, 1) == 1


@pytest.mark.parametrize(("name", "text", "message"), [
    ("t.txt", "", r"\.toml or \.csv"),
    ("t.csv", "one line", "a line of titles"),
    ("t.csv", ",A\nx,,\n", "titles of columns|empty"),
    ("t.csv", ",A\nx,a,b\n", "2 cells, but there are 1 titles"),
    ("t.csv", ",A\nx,\n", "all of its cells are empty"),
    ("t.toml", "columns = 3", "columns as a list"),
    ("t.toml", "rows = ", "no valid TOML"),
    ("t.toml", TOML + "colour = 1\n", "row 1: expected title"),
    ("t.toml", "size = 1\n" + TOML, "got 'size'"),
    ("t.toml", TOML.replace('"columns"', '"cells"'), "shapes_in 'rows' or 'columns', got 'cells'"),
])  # fmt: skip
def test_what_is_no_table_is_refused_in_a_line(tmp_path: Path, name: str, text: str, message: str) -> None:
    with pytest.raises(SettingError, match=message):
        read_figure_table(written(tmp_path, name, text))


def test_a_missing_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"none\.csv: No such file"):
        read_figure_table(tmp_path / "none.csv")
