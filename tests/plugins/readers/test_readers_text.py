"""The reader of text tells from the first lines how rows are written, and never moves a number to another column."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_files import read, refused

from z2p_core.interfaces import RawCloud, ScanError
from z2p_renderer.plugins.readers.text import Text
from z2p_renderer.storage.scans.clouds import read_clouds
from z2p_renderer.storage.scans.content_detection import is_prose

TEXT_FORMS = [(".xyz", 3), (".xyzn", 6), (".xyzrgb", 6), (".pts", 3), (".pts", 4), (".pts", 6), (".pts", 7),
              (".txt", 3), (".txt", 5), (".txt", 9)]  # fmt: skip


@pytest.mark.parametrize(("suffix", "columns"), TEXT_FORMS)
def test_text_round_trip_is_exact(tmp_path: Path, suffix: str, columns: int) -> None:
    table = np.random.default_rng(2).normal(size=(20, columns))
    for separator in (" ", ",", ", ", "\t"):
        rows = [separator.join(map(repr, row)) for row in table.tolist()]
        head = ["20"] if suffix == ".pts" else []
        path = tmp_path / f"scan{suffix}"
        path.write_text("\n".join(["# a comment", *head, *rows[:9], "", f"{rows[9]}  # inline", *rows[10:]]) + "\n")
        assert np.array_equal(read(path)[0], table[:, :3])


def test_non_finite_rows_stay_and_byte_order_marks_go(tmp_path: Path) -> None:
    path = tmp_path / "scan.xyz"
    path.write_bytes(b"\xef\xbb\xbf1 2 3\r\nnan inf 0\r\n")
    assert np.array_equal(read(path)[0], [[1, 2, 3], [np.nan, np.inf, 0]], equal_nan=True)


@pytest.mark.parametrize(
    "head", ["time,X,Y,Z,r", "//time X Y Z r", '"time";"x";"y";"z";"r"', "# time\ntime x y z r", "time, x, y, z, r"]
)
def test_tables_with_a_line_of_names(tmp_path: Path, head: str) -> None:
    table = np.random.default_rng(4).normal(size=(20, 5))
    separator = ";" if ";" in head else ","
    for suffix in (".csv", ".txt", ".asc"):
        path = tmp_path / f"scan{suffix}"
        path.write_text("\n".join([head, *(separator.join(map(repr, row)) for row in table.tolist())]) + "\n")
        assert np.array_equal(read(path)[0], table[:, 1:4])
    (tmp_path / "decimal.csv").write_text("x;y;z\n1,5;2,25;-3\n0;0;1e1\n")
    assert np.array_equal(read(tmp_path / "decimal.csv")[0], [[1.5, 2.25, -3], [0, 0, 10]])
    refused(tmp_path / "a.csv", "a,b,c\n1,2,3\n", "names of columns with x, y and z once each, got 'a,b,c'")
    refused(tmp_path / "a.csv", "x,y,z\n1,2,3,4\n", "names 3 columns")


@pytest.mark.parametrize("suffix", [".xyz", ".xyzn", ".xyzrgb", ".pts", ".csv"])
@pytest.mark.parametrize(
    "head", ["z nx ny x y nz\n", "# z nx ny x y nz\n", "# by hand\n\n## Z nx ny x y nz\n2\n# x y z a b c\n",
             "//Z nx ny X Y nz\n2\n", "2\nz a b x y word\n"]
)  # fmt: skip
def test_column_names_take_precedence_over_the_suffix(tmp_path: Path, suffix: str, head: str) -> None:
    last = ("oak", "old") if "word" in head else ("6", "9")
    assert np.array_equal(given(tmp_path / f"a{suffix}", f"{head}3 4 5 1 2 {last[0]}\n6 7 8 4 5 {last[1]}\n"),
                          [[1, 2, 3], [4, 5, 6]])  # fmt: skip


def test_text_refusals(tmp_path: Path) -> None:
    refused(tmp_path / "a.xyz", "1 2\n", "expected x y z .*, got 2 columns")
    refused(tmp_path / "a.xyz", "a b c\n1 2 3\n", "line 1: expected points, or names")
    refused(tmp_path / "a.xyz", "x y z\n1 2 3 4 5 6\n", "names 3 columns")
    refused(tmp_path / "a.xyz", "1 2 3\n1 2\n", "columns changed from 3 to 2")
    refused(tmp_path / "a.pts", "3\n1 2 3\n4 5 6\n", "promises '3' points, 2 came")
    refused(tmp_path / "a.txt", "1 2\n", "x y z")


NAN = np.nan


def given(path: Path, text: str, columns: str = "") -> np.ndarray:
    """The points of a text, with columns as the user names them."""
    path.write_text(text)
    reader = Text()
    reader.columns = columns.split(",") if columns else None
    (cloud,) = reader.read(path)
    return cloud.points if isinstance(cloud, RawCloud) else cloud


def in_small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_FIRST_BLOCK_CHARACTERS", "_BLOCK_CHARACTERS"):
        monkeypatch.setattr(f"z2p_renderer.plugins.readers._text.line_blocks.{name}", 120)


def refusal(path: Path, text: str, columns: str = "") -> str:
    with pytest.raises(ScanError) as caught:
        given(path, text, columns)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".csv", ".pts"])
@pytest.mark.parametrize("separator", ["\t", " ", "  ", ";", "; ", " \t"])
def test_decimal_commas_are_read_with_other_separators(
    tmp_path: Path, suffix: str, separator: str
) -> None:
    table = np.random.default_rng(3).normal(size=(20, 3)) * ([[1e-6], [1], [1e20], [1e3]] * 5)
    lines = [separator.join(f"{value!r}".replace(".", ",") for value in row) for row in table.tolist()]
    assert np.array_equal(given(tmp_path / f"a{suffix}", "\n".join(lines)), table)


@pytest.mark.parametrize("text", ["1, 2, 3\n4, 5, 6", "1 ,2 ,3\n4 ,5 ,6", "1,2,3\n4,5,6", "1 , 2 , 3\n4,5, 6",
                                  "1 2 3\n4,5,6", "1,2 3\n4 5,6", "1;2 3\n4; 5;6", "1\t2,3\n4 5 6"])  # fmt: skip
def test_commas_separate_unless_all_fields_are_decimals(tmp_path: Path, text: str) -> None:
    assert np.array_equal(given(tmp_path / "a.txt", text), [[1, 2, 3], [4, 5, 6]])


def test_ambiguous_commas_follow_all_sampled_lines(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    assert np.array_equal(given(path, "1,2 3,4 5,6\n7,8 9,1 0,25"), [[1.2, 3.4, 5.6], [7.8, 9.1, 0.25]])
    assert np.array_equal(given(path, "1,2 3,4 5,6\n1 2 3,4,5,6"), [[1, 2, 3], [1, 2, 3]])  # six columns
    assert np.array_equal(given(path, "0,5 0 1,5e-2\n0 0 0"), [[0.5, 0, 0.015], [0, 0, 0]])  # a writer's short zero
    assert np.array_equal(given(path, "1.5,2.5 3.5,4\n"), [[1.5, 2.5, 3.5]])
    late = "0 0 0\n" * 1500 + "0,5 1,5 2,5"  # after the sample
    assert np.array_equal(given(path, late)[-1], [0.5, 1.5, 2.5])


@pytest.mark.parametrize("separator", [",", ";", ", ", " ; "])
def test_an_empty_cell_is_nan_and_keeps_columns_aligned(tmp_path: Path, separator: str) -> None:
    rng = np.random.default_rng(5)
    table = rng.normal(size=(60, 5))
    holes = rng.random(table.shape) < 0.2
    holes[0] = False
    rows = [separator.join("" if hole else repr(value) for value, hole in zip(*row, strict=True))
            for row in zip(table.tolist(), holes.tolist(), strict=True)]  # fmt: skip
    table[holes] = NAN
    for head, axes in (("", [0, 1, 2]), ("t,z,y,x,i\n", [3, 2, 1])):
        for end in ("\n", f"{separator}\n"):  # a separator after the last cell is no column
            points = given(tmp_path / "a.csv", head + end.join([*rows, ""]))
            assert np.array_equal(points, table[:, axes], equal_nan=True)


def test_rows_with_an_empty_coordinate_are_dropped_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("1,2,3,4\n1,,2,3\n4,5,6,\n,,,\n7,8,10,1\n")
    (scan,) = read_clouds(path)
    assert scan.dropped == 2 and np.array_equal(scan.points, [[1, 2, 3], [4, 5, 6], [7, 8, 10]])


@pytest.mark.parametrize(
    "text", ["1,2,3,\n4,5,6,\n", "x,y,z,i\n1,2,3,\n4,5,6,\n", "x,y,z,\n1,2,3,\n4,5,6,\n", "x,y,z\n1,2,3,\n4,5,6,\n",
             "x,y,z,\n1,2,3\n4,5,6\n", "1,2,3\n4,5,6,\n", "1;2;3;\n4;5;6;\n", "x,y,z,i\n1,2,3,\n4,5,6,9\n",
             "1,2,3,#ff0000\n4,5,6,#00ff00"]
)  # fmt: skip
def test_trailing_commas_are_accepted(tmp_path: Path, text: str) -> None:
    assert np.array_equal(given(tmp_path / "a.csv", text), [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    "head", [",x,y,z", ";x;y;z", "\tx\ty\tz", '"","x","y","z"', "id,Easting,Northing,Height", "id,EASTING,northing,Alt",
             "id,easting,northing,elevation", "id,E,x,y,z", "id,POINT_X,POINT_Y,POINT_Z", "id,pos_x,pos_y,pos_z",
             'id,"Points:0","Points:1","Points:2"', "id,x_m,y_m,z_m", "id;X(m);Y(m);Z(m)", "id,X [m],Y [m],Z [m]",
             "id X [m] Y [m] Z (m)", "id\tX [m]\tY [m]\tZ", "//id,x,y,z", "% id x y z", "# by hand\n// too\n,x,y,alt",
             "height,x,y,z", "% by hand\n; of the x, y and z of Ox\n\nid,x,y,z"]
)  # fmt: skip
def test_usual_axis_names_are_recognized(tmp_path: Path, head: str) -> None:
    sign = ";" if ";" in head.splitlines()[-1] else "\t" if "\t" in head else ","
    width = 5 if ",E," in head else 4
    table = np.arange(4.0 * width).reshape(4, width)
    rows = "\n".join(sign.join(map(str, row)) for row in table.tolist())
    path = tmp_path / "a.csv"
    assert np.array_equal(given(path, f"{head}\n{rows}\n"), table[:, -3:])
    assert not is_prose(path)


def test_unknown_column_names_need_the_columns_option(tmp_path: Path) -> None:
    path, rows = tmp_path / "a.csv", "1,2,3\n4,5,6\n"
    for head in ("lon,lat,name", "Ostwerte,Hochwert,H", "Point 1,Point 2,Point 3", "easting,northing,alt,height"):
        refusal_of_head = refusal(path, f"{head}\n{rows}")
        assert repr(head) in refusal_of_head and "line 1: expected" in refusal_of_head
        assert ("height" in refusal_of_head.replace(head, "")) == ("lon" in head)
        assert "--columns x,y,z" in refusal_of_head
        assert np.array_equal(given(path, f"{head}\n{rows}", "z,y,x"), [[3, 2, 1], [6, 5, 4]])
        assert np.array_equal(given(tmp_path / "a.xyz", f"{head}\n{rows}", "x,y,z"), [[1, 2, 3], [4, 5, 6]])
    assert len(given(path, rows, "x,y,z")) == 2  # no row is taken for names
    assert np.array_equal(given(path, "0,5 1,5 2\n" * 3, "x,y,z"), [[0.5, 1.5, 2]] * 3)


@pytest.mark.parametrize("sign", ["//", "%", ";", "// ", "; 12 of 40; by hand, "])
@pytest.mark.parametrize("suffix", [".xyz", ".csv", ".pts"])
def test_leading_comment_lines_are_skipped(tmp_path: Path, sign: str, suffix: str) -> None:
    count = "2\n" if suffix == ".pts" else ""
    text = f"{sign}a scan\n\n{sign}made by x, y and z\n{count}1;2;3\n4;5;6\n"
    assert np.array_equal(given(tmp_path / f"a{suffix}", text), [[1, 2, 3], [4, 5, 6]])
    assert np.array_equal(given(tmp_path / "b.csv", ";1;2;3\n4;5;6;7"), [[NAN, 1, 2], [4, 5, 6]], equal_nan=True)


@pytest.mark.parametrize(
    ("text", "columns"),
    [("x,y,z,label\n1,2,3,tree\n4,5,6,\n", ""), ("name,x,y,z\n\"oak, old\",1,2,3\n\"\",4,5,6\n", ""),
     ("1,2,3,tree\n4,5,6,oak\n", "x,y,z,label"), ("A;B;C;D\n1,0;2,0;3,0;a,b\n4;5;6;c\n", "x,y,z,label"),
     ("x y z label\n1 2 3 tree\n4 5 6 oak\n", ""), ("x y z label\n1,0 2 3 tree\n4 5 6,0 oak\n", ""),
     ("x\ty\tz\tlabel\n1\t2\t3\told oak\n4\t5\t6\t\n", ""), ('x,y,z,i\n"1","2","3",0\n4,5,6,1\n', ""),
     ("x,y,z,when\n1,2,3,2024-01-01 12:00\n4,5,6,\n", ""), ("\tx\ty\tz\t\n 1\t2\t3\t\t\n 4\t5\t6\t\t\n", "")]
)  # fmt: skip
def test_named_columns_allow_words_in_other_columns(tmp_path: Path, text: str, columns: str) -> None:
    assert np.array_equal(given(tmp_path / "a.csv", text, columns), [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("text", "match"),
    [("# made\n\n1 2 3\n\n4 5 six\n", "line 5 column 3 holds 'six'"), ("1 2 3\n# a\n4 5\n", "line 3 .* from 3 to 2"),
     ("x,y,z\n1,2,3\n4,5,b\n", "line 3 column 3 holds 'b'"), ("// a\n\n1,2,3\n4,5,6,7\n", "line 4 .* from 3 to 4"),
     ("1,2,3,tree\n", "line 1 column 4 holds 'tree'.*--columns x,y,z,label"), ("1 2 3\n1_000 2 3", "line 2 .*'1_000'"),
     ("x,y,z,label\n1,2,3,old, oak\n", "names 4 columns .x,y,z,label., the file has 5"),
     ("x,y,z,a\n1,2,3,b\n1,2,3,b,c\n", "line 3 .* from 4 to 5")]
)  # fmt: skip
def test_errors_name_the_line_number_of_the_file(tmp_path: Path, text: str, match: str) -> None:
    refused(tmp_path / "a.csv", text, match)


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("suffix", [".txt", ".csv", ".asc"])
def test_a_column_that_counts_the_rows_is_no_x(
    tmp_path: Path, suffix: str, first: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_small_parts(monkeypatch)
    points = np.random.default_rng(8).normal(size=(30, 3))
    rows = [f"{first + row} {x!r} {y!r} {z!r} 9" for row, (x, y, z) in enumerate(points.tolist())]
    path = tmp_path / f"a{suffix}"
    path.write_text("# made\n30\n" + "\n".join(rows))
    (cloud,) = Text().read(path)
    assert isinstance(cloud, RawCloud) and np.array_equal(cloud.points, points)
    assert "columns 2 to 4; --columns x,y,z,c4,c5 takes it as x" in cloud.note
    as_x = np.column_stack([np.arange(30) + first, points[:, :2]])
    assert np.array_equal(given(path, "\n".join(rows), "x,y,z,c4,c5"), as_x)
    assert np.array_equal(given(path, "\n".join(["x,y,z,a,b", *rows])), as_x)
    for others in (rows[:9], [row.rsplit(maxsplit=2)[0] for row in rows]):
        assert given(path, "\n".join(others))[0, 0] == float(others[0].split()[0])  # few rows, three columns
    for others in ([*rows[:20], *rows[21:]], rows[::-1]):  # with a gap, falling
        assert ",x,y,z,c5 or --columns x,y,z,c4,c5" in refusal(path, "\n".join(others))


def test_line_numbers_count_through_all_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    in_small_parts(monkeypatch)
    rows = [f"{i},{i + 1},{i + 2}" + ("\n# between" if i % 5 == 0 else "") for i in range(60)]
    text = "\n".join(["// made", "x,y,z", *rows, ""])
    assert np.array_equal(given(tmp_path / "a.csv", text), np.arange(60)[:, None] + [[0, 1, 2]])
    line = text.splitlines().index("41,42,43") + 1
    assert f"line {line} column 2 holds 'no'" in refusal(tmp_path / "a.csv", text.replace("41,42,43", "41,no,43"))
    wide = refusal(tmp_path / "a.csv", "1 2 3\n" * 7 + "1 2 3 4\n" * 7)  # each part is even in itself
    assert "line 8 " in wide and "from 3 to 4" in wide


def test_prose_that_begins_like_a_comment_is_prose(tmp_path: Path) -> None:
    for name, text in {"a.txt": "// of a fox\nmade in May\n", "b.csv": "lon,lat,name\n1,2,3\n", "c.txt": "% 1 2 3\n",
                       "d.csv": "name,owner\na,b\n"}.items():  # fmt: skip
        (tmp_path / name).write_text(text)
        assert is_prose(tmp_path / name), text
    for text in ("// by hand\n1 2 3\n", "0,5\t0,25\t1\n", "1,,2,3\n", "; by hand\nX (m);Y (m);Z (m)\n", ",x,y,z\n",
                 '"1","2","3"\n', "'1','2','3','4'\n", "'1 2 3\n"):  # fmt: skip
        (tmp_path / "e.txt").write_text(text)
        assert not is_prose(tmp_path / "e.txt"), text


def test_with_named_columns_a_title_line_is_skipped(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for text in ("lon,lat,name\n1,2,3\n", "// by hand\na;b;c;d\n1;2;3;oak\n", "1,2,3,oak\n"):
        path.write_text(text)
        assert is_prose(path) and not is_prose(path, named=True), text
    for text in ("name,owner\na,b\n", "of a fox\nmade in May\n1 2 3\n", "a,b,c\n1,2\n", "a,b,c\n", ""):
        path.write_text(text)
        assert is_prose(path, named=True), text
