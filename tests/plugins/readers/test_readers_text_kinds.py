"""Texts of other programs: COLMAP's points, PTS of several scans, viewers' tables, degrees, depths, rasters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from z2p_core.interfaces import RawCloud, ScanError
from z2p_renderer.plugins.readers.text import Text
from z2p_renderer.storage.scans.clouds import find_scans, read_clouds
from z2p_renderer.storage.scans.content_detection import is_prose

RNG = np.random.default_rng(5)
XYZ = RNG.normal(size=(60, 3)).round(5)


def given(path: Path, text: str) -> RawCloud:
    path.write_text(text)
    (cloud,) = Text().read(path)
    assert isinstance(cloud, RawCloud)
    return cloud


def refusal(path: Path, text: str) -> str:
    with pytest.raises(ScanError) as caught:
        given(path, text)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def lines(rows: np.ndarray, separator: str = ",") -> str:
    return "".join(separator.join(map(str, row)) + "\n" for row in rows.tolist())


COLMAP_HEAD = """# 3D point list with one line of data per point:
#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)
# Number of points: 60, mean track length: 2
"""


@pytest.mark.parametrize("tracks", ["differing", "alike", "none"])
@pytest.mark.parametrize(("name", "head"), [("points3D.txt", COLMAP_HEAD), ("a.txt", COLMAP_HEAD), 
                                            ("Points3d.txt", "")])
def test_colmaps_points_are_read_by_their_names(tmp_path: Path, name: str, head: str, tracks: str) -> None:
    length = {"differing": lambda row: row % 4, "alike": lambda row: 2, "none": lambda row: 0}[tracks]
    rows = [f"{3 * row + 7} {x} {y} {z} 10 20 30 0.5{' 4 17' * length(row)}\n"
            for row, (x, y, z) in enumerate(XYZ.tolist())]  # fmt: skip
    cloud = given(tmp_path / name, head + "".join(rows))
    assert np.array_equal(cloud.points, XYZ)
    assert (cloud.up, cloud.up_certain) == ("-Y", False) and "COLMAP" in cloud.up_reason
    np.testing.assert_allclose(cloud.fields["rgb"], np.tile([10 / 255, 20 / 255, 30 / 255], (len(XYZ), 1)), atol=1e-6)
    assert not is_prose(tmp_path / name)


def test_names_in_a_comment_fit_rows_of_varying_length(tmp_path: Path) -> None:
    rows = "".join(f"oak {x} {y} {z}{' 1' * (row % 3)}\n" for row, (x, y, z) in enumerate(XYZ.tolist()))
    assert np.array_equal(given(tmp_path / "a.txt", f"# kind x y z neighbours\n{rows}").points, XYZ)
    assert "from 4 to 5" in refusal(tmp_path / "a.txt", f"kind x y z\n{rows}")  # names of all columns have to fit


@pytest.mark.parametrize("width", [3, 4, 7])
def test_scans_of_a_pts_follow_one_another(tmp_path: Path, width: int) -> None:
    table = np.column_stack([XYZ, RNG.integers(-2048, 2048, (60, 1)), RNG.integers(0, 256, (60, 3))])[:, :width]
    parts = [lines(table[:20], " "), lines(table[20:33], " "), lines(table[33:], " ")]
    path = tmp_path / "a.pts"
    cloud = given(path, f"20\n{parts[0]}13\n{parts[1]}27\n{parts[2]}")
    assert np.array_equal(cloud.points, XYZ) and "3 scans in one file" in cloud.note
    assert np.array_equal(given(path, f"60\n{parts[0]}13\n{parts[1]}27\n{parts[2]}").points, XYZ)  # a count of all
    assert "line 22 promises '14' points, 13 came" in refusal(path, f"20\n{parts[0]}14\n{parts[1]}27\n{parts[2]}")
    assert "line 1 promises '21' points, 20 came" in refusal(path, f"21\n{parts[0]}13\n{parts[1]}27\n{parts[2]}")
    bad = parts[1].splitlines()[0] + "\n" + " ".join(["no", *["1"] * (width - 1)])
    assert "line 24 column 1 holds 'no'" in refusal(path, f"20\n{parts[0]}13\n{bad}\n")


AXES = {
    "VeloView": '"Points:0","Points:1","Points:2","intensity"', "VeloView, newer": '"Points_m_XYZ:0","Points_m_XYZ:1",'
    '"Points_m_XYZ:2","intensity"', "ParaView": '"Points_0","Points_1","Points_2","RTData"', "a survey":
    "Easting,Northing,Elevation,Code", "its short names": "E,N,H,Code", "in German": "Rechtswert,Hochwert,Höhe,Punkt",
    "ENU": "e,n,u,Code", "units": "x [m],y [m],z [m],i", "prefixes": "utm_x,utm_y,altitude,i",
    "ROS": "pos.x,pos.y,pos.z,i",
    "of an array": "points[0],points[1],points[2],i", "Open3D": "positions_x,positions_y,positions_z,i",
    "CloudCompare": "//X,Y,Z,R", "longer": "X coordinate,Y coordinate,Z coordinate,i", "metres": "x/m,y/m,z/m,i",
}  # fmt: skip


@pytest.mark.parametrize("viewer", AXES)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_axis_names_of_viewers_are_recognized(tmp_path: Path, viewer: str, separator: str) -> None:
    head, rows = AXES[viewer].replace(",", separator), lines(np.column_stack([XYZ, np.arange(60)]), separator)
    for text in (rows, *([rows.replace(".", ",")] if separator != "," else [])):  # decimal commas
        assert np.array_equal(given(tmp_path / "a.csv", f"{head}\n{text}").points, XYZ)
    assert not is_prose(tmp_path / "a.csv")


def test_axis_columns_are_recognized_among_others(tmp_path: Path) -> None:
    path, beside = tmp_path / "a.csv", np.arange(60)[:, None]
    livox = "Version,Slot ID,LiDAR Index,Rsvd,Error Code,Timestamp,X,Y,Z,Reflectivity,Tag,Ori_x,Ori_y,Ori_z"
    table = np.column_stack([np.repeat(beside, 6, 1), XYZ, np.repeat(beside, 5, 1)])
    assert np.array_equal(given(path, f"{livox}\n{lines(table)}").points, XYZ)
    both = np.column_stack([XYZ + 9, XYZ, beside])
    assert np.array_equal(given(path, f'"Points:0","Points:1","Points:2",X,Y,Z,i\n{lines(both)}').points, XYZ)
    assert np.array_equal(given(path, f"lon,lat,a,easting,northing,height,i\n{lines(both)}").points, XYZ)


def ground() -> np.ndarray:
    column, row = np.meshgrid(np.arange(12), np.arange(10))
    return np.stack([7 + column / 1e3, 60 + row / 1e3, 200 + 3 * np.sin((column + row) / 6)], -1).reshape(-1, 3)


@pytest.mark.parametrize("head", ["lon,lat,alt", "lng,lat,height", "Longitude [deg],Latitude [deg],Elevation (m)",
                                  "LAT,LON,ALT", "gps_lat,gps_lon,h"])  # fmt: skip
def test_degrees_by_name_are_laid_out_in_metres(tmp_path: Path, head: str) -> None:
    rows = ground()
    order = [1, 0, 2] if head.lower().split(",")[0].endswith("lat") else [0, 1, 2]
    cloud = given(tmp_path / "a.csv", f"{head}\n{lines(rows[:, order])}")
    assert np.ptp(cloud.points, axis=0) == pytest.approx([11 * 111.32 * 0.5, 9 * 111.32, np.ptp(rows[:, 2])], rel=1e-3)
    assert np.array_equal(cloud.points[:, 2], rows[:, 2])
    assert (cloud.points[11, 0] > cloud.points[0, 0]) and (cloud.points[-1, 1] > cloud.points[0, 1])
    assert (cloud.up, cloud.up_certain) == ("+Z", True)
    assert "laid out in metres" in cloud.note and "pyproj" in cloud.note


@pytest.mark.parametrize("head", ["x,y,depth", "Easting,Northing,Depth (m)", "x [m];y [m];Sounding", "lon,lat,depth_m"])
def test_depths_become_negative_heights(tmp_path: Path, head: str) -> None:
    rows = np.column_stack([XYZ[:, :2], np.abs(XYZ[:, 2]) + 1])
    separator = ";" if ";" in head else ","
    cloud = given(tmp_path / "a.csv", f"{head}\n{lines(rows, separator)}")
    assert np.array_equal(cloud.points[:, 2], -rows[:, 2]) and "z = -depth" in cloud.note
    assert cloud.up == "+Z"
    below = given(tmp_path / "a.csv", f"{head}\n{lines(rows * [1, 1, -1], separator)}")
    assert np.array_equal(below.points[:, 2], -rows[:, 2]) and "heights" in below.note
    both = given(tmp_path / "a.csv", f"{head}{separator}z\n{lines(np.column_stack([rows, XYZ[:, 2]]), separator)}")
    assert np.array_equal(both.points[:, 2], XYZ[:, 2]) and "depth" not in both.note


def test_exponents_of_fortran_are_numbers(tmp_path: Path) -> None:
    text = lines(XYZ * 1000, " ").replace("e", "D")
    fortran = "\n".join(" ".join(f"{number:.16e}".replace("e", "D") for number in row) for row in XYZ.tolist())
    assert np.array_equal(given(tmp_path / "a.xyz", fortran).points, XYZ)
    words = fortran.replace("\n", " Dd3\n") + " a"
    assert np.array_equal(given(tmp_path / "b.txt", f"x y z name\n{words}").points, XYZ)
    assert np.array_equal(given(tmp_path / "c.csv", fortran.replace("D", "d").replace(" ", ",")).points, XYZ)
    assert np.allclose(given(tmp_path / "d.txt", text).points, XYZ * 1000)
    assert find_scans([str(tmp_path)], False) == sorted(tmp_path.iterdir())


def test_an_esri_grid_gives_the_centers_of_its_cells(tmp_path: Path) -> None:
    heights = "1 2 3 4\n5 -9999 7 8\n"
    for corner, cell, left in (("xllcorner 100\nyllcorner 50", 2, 101), ("XLLCENTER 100\nYLLCENTER 50", 2, 100)):
        cloud = given(tmp_path / "a.asc", f"NCOLS 4\nnrows 2\n{corner}\ncellsize {cell}\nNODATA_value -9999\n{heights}")
        bottom = left - 50
        assert cloud.points.tolist() == [[left + 2 * column, bottom + 2 * row, height] for column, row, height in
                                         ((0, 1, 1), (1, 1, 2), (2, 1, 3), (3, 1, 4), (0, 0, 5), (2, 0, 7), (3, 0, 8))]
    assert "promises 4 x 2 heights, 4 came" in refusal(tmp_path / "a.txt", "NCOLS 4\nnrows 2\ncellsize 1\n1 2 3 4\n")
    assert "cellsize" in refusal(tmp_path / "a.txt", "ncols 4\nnrows 2\ncellsize 0\n1 2 3 4\n")
    assert "'ncols'" in refusal(tmp_path / "a.txt", "ncols\nnrows 2\ncellsize 0\n1 2 3 4\n")


@pytest.mark.parametrize("before", ["", "1 2 3\n4 5 6\n"])
def test_an_endless_line_is_refused_before_it_is_in_memory(
    tmp_path: Path, before: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("z2p_renderer.plugins.readers._text.line_blocks._MAX_LINE_CHARACTERS", 10_000)
    monkeypatch.setattr("z2p_renderer.plugins.readers._text.line_blocks._FIRST_BLOCK_CHARACTERS", 4000)
    monkeypatch.setattr("z2p_renderer.plugins.readers._text.line_blocks._BLOCK_CHARACTERS", 4000)
    path = tmp_path / "a.xyz"
    for endless in ("1 " * 30_000, "\0" * 60_000, "," * 60_000):
        assert f"line {1 + before.count(chr(10))} is longer than" in refusal(path, before + endless)


def test_degrees_beside_metres_get_a_note(tmp_path: Path) -> None:
    path = tmp_path / "a.xyz"
    path.write_text(lines(ground(), " "))
    (scan,) = read_clouds(path)
    assert "x and y look like degrees (7..7.011, 60..60.009)" in scan.note and scan.up == "+Z"
    sizes = [11 * 111.32 * 0.5, 9 * 111.32, np.ptp(ground()[:, 2])]
    assert np.ptp(scan.points, axis=0) == pytest.approx(sizes, rel=0.01)


def test_poses_in_a_folder_are_passed_over(tmp_path: Path) -> None:
    scan = tmp_path / "scan.txt"
    scan.write_text(lines(XYZ, " "))
    turn = [1, 0, 0, 5, 0, 0, -1, 6, 0, 1, 0, 7]
    (tmp_path / "kitti.txt").write_text(lines(np.array([turn] * 90), " "))
    (tmp_path / "tum.txt").write_text("# t tx ty tz qx qy qz qw\n" + lines(
        np.column_stack([1.3e9 + np.arange(60), XYZ, np.tile([0, 0, 0.6, 0.8], (60, 1))]), " "))
    (tmp_path / "pose.txt").write_text(lines(np.array([*turn, 0, 0, 0, 1]).reshape(4, 4), " "))
    (tmp_path / "K.csv").write_text("525,0,320\n0,525,240\n0,0,1\n")
    (tmp_path / "R.txt").write_text("1 0 0\n0 0 -1\n0 1 0\n")
    (tmp_path / "named.csv").write_text("stamp,x,y,z,qx,qy,qz,qw\n1,2,3,4,0,0,0,1\n2,3,3,4,0,0,0,1\n")
    np.save(tmp_path / "poses.npy", np.array([[*turn, 0, 0, 0, 1]] * 9, dtype=float).reshape(9, 4, 4))
    np.save(tmp_path / "scan.npy", XYZ)
    over: list[Path] = []
    assert find_scans([str(tmp_path)], False, over.append) == [tmp_path / "scan.npy", scan]
    assert {path.name for path in over} == {"kitti.txt", "tum.txt", "pose.txt", "K.csv", "R.txt", "named.csv",
                                          "poses.npy"}
    for name in ("tum.txt", "named.csv"):
        with pytest.raises(ScanError, match="list of poses"):
            read_clouds(tmp_path / name)
    places = read_clouds(tmp_path / "tum.txt", ("t", "x", "y", "z", "qx", "qy", "qz", "qw"))
    assert np.array_equal(places[0].points, XYZ)
