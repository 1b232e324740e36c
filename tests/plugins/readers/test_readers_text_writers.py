"""Texts as spreadsheets and languages write them: columns that have but numbers, rows that have names, odd writing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_files import cloud, read, refused

POINTS = cloud()
ROWS = [",".join(map(repr, point)) for point in POINTS.tolist()]


def given(path: Path, lines: list[str], encoding: str = "utf-8") -> np.ndarray:
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return read(path)[0]


@pytest.mark.parametrize("title", ["0,1,2", '"V1","V2","V3"', "Var1,Var2,Var3", "X1,X2,X3", "col_0,col_1,col_2"])
def test_a_line_of_column_numbers_is_no_point(tmp_path: Path, title: str) -> None:
    assert np.array_equal(given(tmp_path / "a.csv", [title, *ROWS]), POINTS)


@pytest.mark.parametrize("title", [",0,1,2", '"","V1","V2","V3"', "Unnamed: 0,0,1,2", "Row,Var1,Var2,Var3"])
def test_a_line_of_column_numbers_above_numbered_rows(tmp_path: Path, title: str) -> None:
    rows = [f"{index},{row}" for index, row in enumerate(ROWS)]
    assert np.array_equal(given(tmp_path / "a.csv", [title, *rows]), POINTS)


@pytest.mark.parametrize("first", ["0,1,2", "1,2,3"])
def test_a_first_row_of_integers_is_a_point(tmp_path: Path, first: str) -> None:
    points = given(tmp_path / "a.csv", [first, "5,7,9", "3,1,4", "8,8,1"])
    assert points[0].tolist() == [float(cell) for cell in first.split(",")] and len(points) == 4


@pytest.mark.parametrize("title", ['"x" "y" "z"', "x y z", '"V1" "V2" "V3"'])
@pytest.mark.parametrize("names", ['"{}"', "{}", '"point {}"'])
def test_row_names_of_r_have_no_title(tmp_path: Path, title: str, names: str) -> None:
    if "V1" in title and "point" in names:
        return refused(tmp_path / "b.txt", f"{title}\n\"point 1\" 1.5 2.5 3.5\n", "holds 'point 1', which is no number")
    rows = [f"{names.format(index)} {row.replace(',', ' ')}" for index, row in enumerate(ROWS, start=1)]
    assert np.array_equal(given(tmp_path / "a.txt", [title, *rows]), POINTS)


def test_header_with_too_few_names_needs_the_columns_option(tmp_path: Path) -> None:
    rows = "".join(f"{row},7\n" for row in ROWS)
    refused(tmp_path / "a.csv", f"x,y,z\n{rows}", "names 3 columns .* the file has 4")


@pytest.mark.parametrize("title", ["#Label,X/Longitude,Y/Latitude,Z/Altitude", "vertex_index,co_x,co_y,co_z",
                                   "name,location_x,location_y,location_z"])  # fmt: skip
def test_axis_names_with_prefixes_are_recognized(tmp_path: Path, title: str) -> None:
    assert np.array_equal(given(tmp_path / "a.csv", [title, *(f"p1,{row}" for row in ROWS)]), POINTS)


def test_titles_in_cp1252_are_read(tmp_path: Path) -> None:
    rows = [row.replace(",", ";").replace(".", ",") for row in ROWS]
    assert np.array_equal(given(tmp_path / "a.csv", ["Rechtswert;Hochwert;Höhe", *rows], "cp1252"), POINTS)


@pytest.mark.parametrize(
    ("text", "advice"),
    [("x;y;z\n446.032,868;5.411.000,1;3,5\n", "'446.032,868' has marks between its thousands"),
     ('x,y,z\n"446,032.868","5,411,000.1",3.5\n', "'446,032.868' has marks between its thousands"),
     ("x;y;z\n446'032.868;1;2\n", "has marks between its thousands"),
     ("[0.1, 0.2, 0.3]\n[1, 2, 3]\n", "numbers stand in brackets"), ("(-0.1 0.2 0.3)\n", "numbers stand in brackets"),
     ("range,azimuth,elevation\n2,10,3\n", "a distance and angles"), ("R,Theta,Phi,I\n1,2,3,4\n", "z = r sin"),
     ("lon;lat;h\n7°06'3.1\";50°12'4.2\";30\n", "degrees, minutes and seconds"),
     ('WKT,fid\n"POINT Z (1 2 3)",1\n', "written as geometry .* AS_XYZ"), ("POINT(1 2 3)\n", "written as geometry")],
)  # fmt: skip
def test_unsupported_notations_get_advice(tmp_path: Path, text: str, advice: str) -> None:
    refused(tmp_path / "a.csv", text, f"line [12]: .*{advice}")
