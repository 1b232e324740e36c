"""What may stand before the rows of a text file: a mark of its encoding, a count, units, words for other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_files import cloud, read, refused

from z2p_core.interfaces import ScanError
from z2p_renderer.storage.scans.clouds import find_scans, read_clouds

ROWS = "1,2,3\n4,5,6\n7,8,10\n"
POINTS = [[1, 2, 3], [4, 5, 6], [7, 8, 10]]


def given(path: Path, content: str | bytes) -> np.ndarray:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read(path)[0]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("suffix", [".csv", ".txt", ".xyz"])
def test_the_first_bytes_determine_the_encoding(tmp_path: Path, encoding: str, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    assert np.array_equal(given(path, ROWS.replace("\n", "\r\n").encode(encoding)), POINTS)
    assert find_scans([str(tmp_path)], False, lambda path: pytest.fail(f"{path} was passed over")) == [path]
    refused(path, ROWS.replace("8", "ä").encode(encoding), "line 3 column 2 holds 'ä'")
    if suffix != ".xyz":
        assert np.array_equal(given(path, f"x\ty\tz\n{ROWS.replace(',', chr(9))}".encode(encoding)), POINTS)


def test_utf_16_of_the_other_byte_order(tmp_path: Path) -> None:
    assert np.array_equal(given(tmp_path / "a.txt", f"\ufeff{ROWS}".encode("utf-16-be")), POINTS)


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".asc", ".csv", ".pts"])
@pytest.mark.parametrize("head", ["3\n", "# made\n\n3\n", "// made\n 3 \n"])
def test_a_number_of_rows_is_no_row(tmp_path: Path, suffix: str, head: str) -> None:
    path = tmp_path / f"a{suffix}"
    assert np.array_equal(given(path, head + ROWS), POINTS)
    assert find_scans([str(tmp_path)], False) == [path]
    refused(path, head.replace("3", "4") + ROWS, f"line {head.count(chr(10))} promises '4' points, 3 came; mend .* or")


@pytest.mark.parametrize("head", ["//X Y Z R G B\n3\n", "X,Y,Z,R,G,B\n3\n", "3\nX,Y,Z,R,G,B\n"])
def test_a_number_of_rows_beside_names(tmp_path: Path, head: str) -> None:
    rows = "".join(f"{row},7,8,9\n" for row in ROWS.split())
    assert np.array_equal(given(tmp_path / "a.asc", head + rows), POINTS)
    assert np.array_equal(given(tmp_path / "a.csv", head + rows), POINTS)
    refused(tmp_path / "a.asc", f"{head}{rows}1,2,b,3,4,5\n", "line 6 column 3 holds 'b'")


def test_atoms_of_a_molecule_are_points(tmp_path: Path) -> None:
    path = tmp_path / "a.xyz"
    atoms = "C 1 2 3\nCl 4 5 6\nH2 7 8 10\n"
    for text in (f"3\n\n{atoms}", f"3\nmade by x\n{atoms}", f"3\n0 0 1\n{atoms.replace(' ', chr(9))}",
                 "3\nc\nC 1 2 3 0.5\nO 4 5 6 1\nO 7 8 10 2\n"):  # fmt: skip
        assert np.array_equal(given(path, text), POINTS)
    refused(path, f"4\nc\n{atoms}", "line 1 promises '4' points, 3 came")
    refused(path, f"3\nc\n{atoms}3\nc\n{atoms}", "line 6 the number of columns changed from 4 to 1")


def test_the_separator_line_of_excel_is_no_row(tmp_path: Path) -> None:
    rows = "1,0;2;3\n4;5;6\n7;8;10\n"
    for head in ("sep=;\n", '"sep=;"\n', "SEP=;\nx;y;z\n", "# made\nsep=;\nx;y;z\n"):
        assert np.array_equal(given(tmp_path / "a.csv", head + rows), POINTS)
        assert find_scans([str(tmp_path)], False) == [tmp_path / "a.csv"]


@pytest.mark.parametrize("units", ["[m],[m],[m]", "m,m,m", "(m) (m) (mm)", '"[m]","[m]","[m]"', "[m];[us-ft];[m]"])
def test_a_line_of_units_below_the_names_is_no_row(tmp_path: Path, units: str) -> None:
    path = tmp_path / "a.csv"
    assert np.array_equal(given(path, f"x,y,z\n{units}\n{ROWS}"), POINTS)
    refused(path, f"x,y,z\n{units}\n{units}\n{ROWS}", "line 3")  # one such row
    refused(path, f"x,y,z\na,b,c\n{ROWS}", "line 2 column 1 holds 'a'")


@pytest.mark.parametrize("word", ["NA", "None", "null", "N/A", "<NA>", '"NULL"', "nan", ""])
def test_words_for_missing_numbers_are_counted_as_not_finite(tmp_path: Path, word: str) -> None:
    path = tmp_path / "a.csv"
    for head in ("x,y,z\n", ""):
        for rows in (ROWS + f"{word},{word},{word}\n", f"{word},{word},{word}\n{ROWS}"):
            path.write_text(head + rows)
            (scan,) = read_clouds(path)
            assert scan.dropped == 1 and np.array_equal(scan.points, POINTS)
            assert not word or find_scans([str(tmp_path)], False) == [path]
    refused(path, f"{ROWS}no,no,no\n", "line 4 column 1 holds 'no'")


def test_errors_on_other_columns_name_their_line(tmp_path: Path) -> None:
    refused(tmp_path / "a.xyz", "# made\n\n1 2\n", "^line 3: expected x y z .* got 2 columns")
    refused(tmp_path / "a.txt", "Project: fox; in 2024\n1;2;3\n", "^line 1: expected x y z .*put '#' before lines")
    assert len(given(tmp_path / "a.txt", "\n".join(" ".join(map(str, row)) for row in cloud(9).tolist()))) == 9


def test_hash_signs_within_a_line(tmp_path: Path) -> None:
    path, numbered = tmp_path / "a.csv", "".join(f"{n},{row}\n" for n, row in enumerate(ROWS.split()))
    assert np.array_equal(given(path, f"Point #,x,y,z\n{numbered}"), POINTS)
    assert find_scans([str(tmp_path)], False) == [path]
    assert np.array_equal(given(path, f"x,y,z # in metres\n{ROWS}"), POINTS)
    colored = "".join(f"{row} #ff00aa\n" for row in ROWS.replace(",", " ").splitlines())
    refused(tmp_path / "a.txt", f"x y z color\n{colored}", "^line 2: .*on that line '#' begins a comment")
    refused(path, f"{ROWS}1,2 #ff00aa\n", "line 4 .*on that line '#' begins a comment")
    with pytest.raises(ScanError) as error:
        given(path, f"{ROWS}1,2\n")
    assert "'#' begins" not in str(error.value)
