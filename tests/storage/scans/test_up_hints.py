"""The up axis from headers and from files beside a scan."""

from __future__ import annotations

import gzip
import json
import os
from pathlib import Path

import numpy as np
import pytest

from z2p_core.interfaces import RawCloud
from z2p_renderer.storage.scans import up_hints
from z2p_renderer.storage.scans.clouds import Scan, read_clouds

POINTS = np.random.default_rng(3).random((40, 3))
ROWS = "".join(f"{x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in POINTS)
PCD = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 40\nHEIGHT 1\nPOINTS 40\n"
PLY = "element vertex 40\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
VTP = """<VTKFile type="PolyData" version="1.0"><!-- {} --><PolyData><Piece NumberOfPoints="40"><Points>
<DataArray type="Float64" NumberOfComponents="3" format="ascii">{}</DataArray>
</Points></Piece></PolyData></VTKFile>"""


def text_of(suffix: str, comment: str) -> str:
    """A scan of `POINTS` with a comment in its header."""
    match suffix:
        case ".ply":
            return f"ply\nformat ascii 1.0\ncomment {comment}\n{PLY}{ROWS}"
        case ".pcd":
            return f"# .PCD v.7 - Point Cloud Data file format\nVERSION .7\n# {comment}\n{PCD}DATA ascii\n{ROWS}"
        case ".obj":
            return f"# {comment}\n" + "".join(f"v {row}\n" for row in ROWS.splitlines())
        case ".off":
            return f"OFF\n# {comment}\n40 0 0\n{ROWS}"
        case ".vtk":
            return f"# vtk DataFile Version 3.0\n{comment}\nASCII\nDATASET POLYDATA\nPOINTS 40 double\n{ROWS}"
        case ".vtp":
            return VTP.format(comment, ROWS)
    return f"# {comment}\n{ROWS}"


def read(path: Path) -> Scan:
    (scan,) = read_clouds(path)
    assert len(scan.points) == 40
    return scan


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".obj", ".off", ".xyz", ".txt", ".asc", ".csv", ".vtk", ".vtp"])
def test_a_comment_in_the_header_gives_up(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"scan{suffix}"
    for comment, up in [("right-handed, -Y up", ("-Y", True)), ("Record3D", ("+Y", False)), ("set up", ("", True))]:
        path.write_text(text_of(suffix, comment))
        assert (read(path).up, read(path).up_certain) == up
        assert up[1] is False or not up[0] or comment in read(path).up_reason


@pytest.mark.parametrize("line", ["obj_info up axis: X", "comment up axis: X"])
def test_ply_comments_and_obj_info_give_up_but_rows_do_not(tmp_path: Path, line: str) -> None:
    path = tmp_path / "scan.ply"
    path.write_text(f"ply\nformat ascii 1.0\n{line}\n{PLY}{ROWS}comment up axis: Z\n")
    assert read(path).up == "+X"


def test_slashes_begin_comments_in_text_files(tmp_path: Path) -> None:
    path = tmp_path / "scan.xyz"
    path.write_text(f"// y-up\n{ROWS}")
    assert read(path).up == "+Y"


def test_up_hints_work_for_compressed_files(tmp_path: Path) -> None:
    for name, comment in (("one.ply.gz", "Z-up"), ("two.ply.gz", "none")):
        (tmp_path / name).write_bytes(gzip.compress(text_of(".ply", comment).encode()))
    (tmp_path / "two.json").write_text('{"up_axis": "X"}')
    assert [read(tmp_path / f"{name}.ply.gz").up for name in ("one", "two")] == ["+Z", "+X"]


@pytest.mark.parametrize(
    "value, up",
    [("Y", "+Y"), ("-z", "-Z"), ("Y_UP", "+Y"), ([0, 0, 1], "+Z"), ([0.0, -1, 0], "-Y"), ("auto", ""), ("up", ""),
     (1, ""), ([0, 0, 0], ""), (["Y"], ""), ([0, 1], ""), (None, ""), ({"y": 1}, ""), ([True, False, False], "")],
)  # fmt: skip
@pytest.mark.parametrize("key", ["up_axis", "upAxis", "UpAxis"])
def test_a_json_description_beside_the_scan_gives_up(tmp_path: Path, key: str, value: object, up: str) -> None:
    path = tmp_path / "scan.xyz"
    path.write_text(ROWS)
    for name, content in (("metadata.json", {key: value}), ("scan.json", {"frame": {key: value}, "size": 3})):
        (tmp_path / name).write_text(json.dumps(content))
        scan = read(path)
        assert scan.up == up and scan.up_certain and (not up or name in scan.up_reason)
        (tmp_path / name).unlink()


def test_the_json_key_up_counts_only_at_the_top_level(tmp_path: Path) -> None:
    path = tmp_path / "scan.xyz"
    path.write_text(ROWS)
    for content, up in (({"up": "Y"}, "+Y"), ({"camera": {"up": [0, 0, 1]}}, "")):
        (tmp_path / "scan.json").write_text(json.dumps(content))
        assert read(path).up == up


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "3", '{"up_axis": NaN}', "[" * 100_000, '{"up_axis": "Y", "upAxis": "Z"}', "\x00",
             '{"up_axis": "Y"}' + " " * (1 << 20)]
)  # fmt: skip
def test_a_damaged_or_ambiguous_description_is_ignored(tmp_path: Path, text: str) -> None:
    path = tmp_path / "scan.xyz"
    path.write_text(ROWS)
    (tmp_path / "metadata.json").write_text(text)
    assert read(path).up == ""


def test_a_folder_or_pipe_as_json_description_is_ignored(tmp_path: Path) -> None:
    (tmp_path / "scan.xyz").write_text(ROWS)
    (tmp_path / "metadata.json").mkdir()
    os.mkfifo(tmp_path / "scan.json")
    assert read(tmp_path / "scan.xyz").up == ""


def test_a_gltf_scene_of_the_same_name_suggests_its_axis(tmp_path: Path) -> None:
    for name in ("scan.xyz", "other.xyz", "told.ply"):
        (tmp_path / name).write_text(ROWS if name.endswith("z") else text_of(".ply", "Z up"))
    (tmp_path / "scan.glb").touch()
    (tmp_path / "told.gltf").touch()
    scans = [read(tmp_path / name) for name in ("scan.xyz", "other.xyz", "told.ply")]
    assert [(scan.up, scan.up_certain) for scan in scans] == [("+Y", False), ("", True), ("+Z", True)]


def test_certain_up_of_a_reader_wins_over_hints(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    path.write_text(text_of(".ply", "Y up"))
    given = [RawCloud(POINTS, up="-X", up_certain=certain, up_reason="so") for certain in (True, False)]
    assert [cloud.up for cloud in up_hints.with_up_hints(given, path, path)] == ["-X", "+Y"]
    path.write_text(text_of(".ply", "Scaniverse"))
    assert [cloud.up for cloud in up_hints.with_up_hints(given, path, path)] == ["-X", "-X"]


def test_geographic_heights_override_a_usual_axis(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    rows = "".join(f"{8 + x / 1000:.7f},{47 + y / 1000:.7f},{400 + z:.3f}\n" for x, y, z in POINTS)
    path.write_text(f"# iPhone\nlongitude,latitude,altitude\n{rows}")
    assert (read(path).up, read(path).up_certain) == ("+Z", True)


@pytest.mark.parametrize("title, up", [("Exported from Blender-4.1.1", "+Z"), ("part, Y-up", "+Y"), ("part", "")])
def test_the_title_of_an_stl_file_gives_up(tmp_path: Path, title: str, up: str) -> None:
    rows = np.zeros(13, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    rows["corners"] = POINTS[:39].reshape(13, 3, 3)
    path = tmp_path / "part.stl"
    path.write_bytes(title.encode().ljust(80, b"\0") + np.uint32(13).tobytes() + rows.tobytes())
    (scan,) = read_clouds(path)
    assert (len(scan.points), scan.up) == (39, up)
