"""What stands before x, y and z in a table is asked about, and coordinates that are whole numbers are still read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from z2p_core.interfaces import RawCloud, ScanError
from z2p_renderer.plugins.readers.text import Text

RNG = np.random.default_rng(3)
XYZ = RNG.normal(size=(240, 3)).round(4)
COLOURS = RNG.integers(0, 256, (240, 3))
NORMALS = XYZ / np.linalg.norm(XYZ, axis=1, keepdims=True)
SUFFIXES = (".txt", ".xyz", ".csv", ".asc", ".pts")


def table(*columns: np.ndarray) -> np.ndarray:
    return np.column_stack([np.asarray(column, dtype=np.float64) for column in columns])


def read(path: Path, rows: np.ndarray, columns: str = "") -> RawCloud:
    lines = [",".join(f"{number:.17g}" for number in row) for row in rows.tolist()]
    path.write_text("\n".join([str(len(lines)), *lines] if path.suffix == ".pts" else lines))
    reader = Text()
    reader.columns = columns.split(",") if columns else None
    (cloud,) = reader.read(path)
    assert isinstance(cloud, RawCloud)
    return cloud


ROW, COLUMN = np.divmod(np.arange(240), 16)
BEFORE = {
    "row,column,x,y,z": (ROW, COLUMN, XYZ),
    "row,column,x,y,z,r,g,b": (ROW, COLUMN, XYZ, COLOURS),
    "row,column,x,y,z,c6": (COLUMN, ROW, XYZ, np.full(240, 0.3)),
    "row,column,x,y,z,c6,r,g,b": (ROW[::-1], COLUMN, XYZ, COLOURS[:, 0] / 7, COLOURS),
    "label,x,y,z": (np.arange(240) % 4, XYZ),
    "label,x,y,z,nx,ny,nz": (np.arange(240) // 60, XYZ, NORMALS),
    "label,x,y,z,c5": (np.full(240, 2), XYZ, COLOURS[:, 0]),
    "id,x,y,z": (np.cumsum(1 + np.arange(240) % 3), XYZ),
    "id,x,y,z,r,g,b": (1000 + np.arange(240), XYZ, COLOURS),
    "time,x,y,z": (1.6e9 + np.arange(240) / 100, XYZ),
    "time,x,y,z,c5": (np.arange(240) / 1000, XYZ, COLOURS[:, 0]),
}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("names", BEFORE)
def test_leading_columns_need_the_columns_option(tmp_path: Path, suffix: str, names: str) -> None:
    rows = table(*BEFORE[names])
    with pytest.raises(ScanError) as caught:
        read(tmp_path / f"a{suffix}", rows)
    said = str(caught.value)
    assert f"--columns {names} or " in said and "\n" not in said
    as_they_stand = said.rsplit("--columns ", 1)[1]
    assert np.array_equal(read(tmp_path / f"a{suffix}", rows, names).points, XYZ)
    assert np.array_equal(read(tmp_path / f"a{suffix}", rows, as_they_stand).points, rows[:, :3])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_leading_row_index_column_is_skipped_with_a_note(tmp_path: Path, suffix: str) -> None:
    for first in (0, 1):
        cloud = read(tmp_path / f"a{suffix}", table(np.arange(240) + first, XYZ, COLOURS))
        assert np.array_equal(cloud.points, XYZ) and "column 1 counts the rows" in cloud.note
        assert "columns 5 to 7 taken as colours" in cloud.note
    with pytest.raises(ScanError, match=r"columns 2 and 3 .*--columns c1,row,column,x,y,z or --columns c1,x,y,z,"):
        read(tmp_path / f"a{suffix}", table(np.arange(240), ROW, COLUMN, XYZ))


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(("first", "names"), [(NORMALS, "nx,ny,nz"), (COLOURS, "r,g,b")])
def test_leading_normals_or_colours_need_the_columns_option(
    tmp_path: Path, suffix: str, first: np.ndarray, names: str
) -> None:
    with pytest.raises(ScanError, match=f"columns 1 to 3 may be .*--columns {names},x,y,z or --columns x,y,z,c4,c5,c6"):
        read(tmp_path / f"a{suffix}", table(first, XYZ))


def voxels() -> np.ndarray:
    return np.stack(np.meshgrid(*[np.arange(7)] * 3, indexing="ij"), -1).reshape(-1, 3)[:240]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    "columns",
    [(voxels(),), (voxels(), COLOURS[:, 0]), (voxels(), COLOURS), (voxels(), NORMALS), (voxels(), XYZ[:, 0]),
     ((XYZ * 1000).astype(int), COLOURS), ((XYZ * 1000).astype(int), COLOURS[:, 0]), (ROW, COLUMN, XYZ[:, 2]),
     (ROW, COLUMN, XYZ[:, 2], COLOURS[:, 0]), (ROW, COLUMN, XYZ[:, 2], COLOURS), (ROW, COLUMN, XYZ[:, 2], NORMALS),
     (ROW, COLUMN, XYZ[:, 2], COLOURS / 255), (np.sort(XYZ[:, 0]), XYZ[:, 1:], COLOURS), (XYZ + 6e5, COLOURS),
     (XYZ, NORMALS, COLOURS), (XYZ, np.full(240, 0.3), COLOURS), (XYZ, RNG.normal(size=(240, 12)))],
    ids=lambda columns: "",
)  # fmt: skip
def test_coordinates_come_first_beside_any_other_columns(
    tmp_path: Path, suffix: str, columns: tuple[np.ndarray, ...]
) -> None:
    rows = table(*columns)
    assert np.array_equal(read(tmp_path / f"a{suffix}", rows).points, rows[:, :3])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_note_tells_where_colors_are_guessed(tmp_path: Path, suffix: str) -> None:
    path, is_fixed = tmp_path / f"a{suffix}", suffix == ".pts"
    assert read(path, XYZ).note == ""
    assert read(path, table(XYZ, COLOURS)).note == ("" if is_fixed else "columns 4 to 6 taken as colours")
    assert read(path, table(XYZ, NORMALS)).note == ""
    assert read(path, table(XYZ, COLOURS[:, 0])).note == ""
    expected = "" if is_fixed else "columns 5 to 7 taken as colours"
    assert read(path, table(XYZ, XYZ[:, 0], COLOURS)).note == expected
    assert read(path, table(XYZ, COLOURS), "x,y,z,r,g,b").note == ""


def poses(width: int) -> np.ndarray:
    turns = []
    for angle in np.linspace(0, 1, 20):
        cos, sin = np.cos(angle), np.sin(angle)
        turns.append(np.array([[cos, -sin, 0, angle], [sin, cos, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]))
    flat = np.array(turns).reshape(20, 16)[:, : width - width % 4]
    return table(np.arange(20), flat) if width % 4 else flat


@pytest.mark.parametrize(
    "rows",
    [poses(12), poses(16), poses(13), poses(17), poses(16)[3].reshape(4, 4), poses(16)[3].reshape(4, 4)[:3],
     table(np.arange(30) / 30, np.ones((30, 3)), np.tile([0.5, -0.5, 0.5, 0.5], (30, 1))),
     table(np.ones((30, 3)), np.tile([0.5, -0.5, 0.5, 0.5], (30, 1))),
     np.array([[500, 0, 320], [0, 500, 240], [0, 0, 1]])],
    ids=str,
)  # fmt: skip
def test_poses_and_matrices_of_cameras_are_no_points(tmp_path: Path, rows: np.ndarray) -> None:
    for suffix in (".txt", ".csv"):
        with pytest.raises(ScanError, match=r"these rows are no points but .*(camera|poses)"):
            read(tmp_path / f"a{suffix}", rows)
    names = ",".join(["x", "y", "z", *(f"c{column}" for column in range(3, rows.shape[1]))])
    assert np.array_equal(read(tmp_path / "a.txt", rows, names).points, rows[:, :3])


@pytest.mark.parametrize("suffix", [".txt", ".csv", ".asc"])
def test_rows_of_a_picture_are_no_points(tmp_path: Path, suffix: str) -> None:
    row, column = np.mgrid[:30, :40]
    for heights in (2 + np.sin(row / 9) * np.cos(column / 7), RNG.random((30, 40)), (row + column)[:, :10] / 7):
        with pytest.raises(ScanError, match=r"depth map or a grid of heights.* cx\) \* depth / fx"):
            read(tmp_path / f"a{suffix}", heights)
