"""What scanners and cars' lidars write: PTX, and rows of float32 without a header."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_files import cloud, ptx, read, refused

from z2p_core.interfaces import ScanError
from z2p_renderer.plugins.readers.ptx import Ptx
from z2p_renderer.plugins.readers.raw_lidar import Sweeps
from z2p_renderer.storage.scans.clouds import find_scans

TURNED = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [1000, 2000, 3000, 1]])
"""A quarter turn about +Z, then a shift, of points that are rows."""


@pytest.mark.parametrize("lines", [7, 200_000])
def test_ptx_joins_its_scans_by_their_matrices(
    tmp_path: Path, lines: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("z2p_renderer.plugins.readers.ptx._BLOCK_LINES", lines)
    first, second = cloud(30), cloud(21)
    path = tmp_path / "a.ptx"
    path.write_text(ptx(first) + ptx(second, matrix=TURNED) + "\n")
    (points,) = read(path)
    x, y, z = second.T
    assert np.array_equal(points[:30], first)
    np.testing.assert_allclose(points[30:], np.column_stack([1000 - y, 2000 + x, 3000 + z]))
    path.write_bytes(b"\xef\xbb\xbf" + ptx(first).replace("\n", "\r\n").encode())
    assert np.array_equal(read(path)[0], first)
    assert Ptx().read(path)[0].field_names == ("intensity", "rgb")
    path.write_text("0\n5\n" + ptx(first).split("\n", 2)[2].rsplit("\n", 32)[0])  # a scan without a column
    assert len(read(path)[0]) == 0


def test_ptx_refusals(tmp_path: Path) -> None:
    path, text = tmp_path / "a.ptx", ptx(cloud(30))
    rows = text.splitlines()
    refused(path, "\n".join(rows[:-3]), "31 x 1 cells ends in line 38, after 28; the file is cut short")
    refused(path, "\n".join(rows[10:]), "line 1: expected the header of a scan .* rename it to .txt")
    refused(path, text + "\n".join(rows[:7]), "line 42: expected the header")
    refused(path, text.replace(rows[15], "1 2 none 0.5"), "line 16: expected x y z intensity, got '1 2 none 0.5'")
    refused(path, text.replace(rows[15], "1 2"), "line 16: expected x y z intensity, got '1 2'")
    refused(path, text.replace("31\n1\n", "-31\n-1\n"), "line 1: expected the header of a scan")


def test_ptx_needs_the_memory_of_its_points_not_of_its_text(tmp_path: Path) -> None:
    path = tmp_path / "a.ptx"
    path.write_text(ptx(cloud(5000)))
    assert 4900 * 170 < Ptx().memory(path) < 5300 * 170


@pytest.mark.parametrize(("name", "width"), [("000.bin", 4), ("a.pcd.bin", 5), ("a.PCD.BIN", 5), ("short.bin", 5)])
def test_sweeps_are_recognized_by_name_and_size(tmp_path: Path, name: str, width: int) -> None:
    points = 80 * cloud(61 if "short" in name else 80, "f4")
    table = np.column_stack([points, np.full((len(points), width - 3), 17.0)])
    (tmp_path / name).write_bytes(table.astype("<f4").tobytes())
    assert np.array_equal(read(tmp_path / name)[0], points)


def test_named_columns_override_those_of_a_sweep(tmp_path: Path) -> None:
    path, table = tmp_path / "a.bin", 1e5 * cloud(40).astype("<f4")
    path.write_bytes(np.column_stack([table, table]).tobytes())
    reader = Sweeps()
    reader.columns = ("a", "b", "z", "y", "c", "x")
    assert np.array_equal(reader.read(path)[0].points, table[:, [2, 0, 2]])
    reader.columns = ("x", "y", "z", "a", "b", "c", "d")
    with pytest.raises(ScanError, match="28 bytes each, got 960 bytes; name the columns"):
        reader.read(path)


@pytest.mark.parametrize("columns", [3, 4, 6])
@pytest.mark.parametrize("kind", ["<f8", "<f4"])
def test_float64_without_header_is_reported(tmp_path: Path, columns: int, kind: str) -> None:
    path, table = tmp_path / "a.bin", np.resize(cloud(90), (45, columns)).astype(kind)
    path.write_bytes(table.astype("<f8").tobytes())
    for names in (None, ("x", "y", "z")):
        reader = Sweeps()
        reader.columns = names
        with pytest.raises(ScanError, match=r"are float64, .* numpy.fromfile\('a.bin'\)"):
            reader.read(path)
    path.write_bytes(np.resize(cloud(90), (60, columns)).astype("<f4").tobytes())
    reader = Sweeps()
    reader.columns = ("x", "y", "z", "a", "b", "c")[:columns]
    assert len(reader.read(path)[0].points) == 60


def test_implausible_numbers_are_no_sweep(tmp_path: Path) -> None:
    path, table = tmp_path / "a.bin", np.column_stack([cloud(40), np.full(40, 0.5)]).astype("<f4")
    for row, column, value in ((3, 0, np.nan), (4, 2, 1e9), (5, 3, -1), (6, 1, 1e-42)):
        bad = table.copy()
        bad[row, column] = value
        refused(path, bad.tobytes(), "no lidar measures; .* --columns x,y,z,intensity,ring")
    refused(path, np.arange(1000, dtype="<i4").tobytes(), "no lidar measures")
    refused(path, table.tobytes() + b"abc", "its 643 bytes are no whole rows")


def six_columns(count: int, last: np.ndarray) -> np.ndarray:
    """Rows of a room that lies wholly at positive places, so that a wrong cut leaves numbers as lidars have them."""
    places = np.random.default_rng(3).uniform(0, 5, (count, 3))
    return np.column_stack([places, last]).astype("<f4")


@pytest.mark.parametrize("kind", ["whole", "unit", "normals"])
@pytest.mark.parametrize("count", [2000, 2001, 2005])
def test_rows_of_six_floats_need_the_columns_option(tmp_path: Path, kind: str, count: int) -> None:
    rng = np.random.default_rng(4)
    last = {"whole": rng.integers(0, 256, (count, 3)), "unit": rng.uniform(0, 1, (count, 3)) ** 3,
            "normals": np.linalg.qr(rng.normal(size=(count, 3, 3)))[0][:, 0]}[kind]  # fmt: skip
    path, table = tmp_path / "room.bin", six_columns(count, last)
    path.write_bytes(table.tobytes())
    names = "x,y,z,nx,ny,nz" if kind == "normals" else "x,y,z,r,g,b"
    with pytest.raises(ScanError, match=rf"--columns {names} \({count} points\)"):
        Sweeps().read(path)
    reader = Sweeps()
    reader.columns = names.split(",")
    assert np.array_equal(reader.read(path)[0].points, table[:, :3])
    assert [path.name for path in find_scans([str(tmp_path)], False)] == ["room.bin"]  # it is not passed over


def sweep(rows: int = 4000) -> np.ndarray:
    """x, y, z, intensity and ring of a lidar whose 32 beams take turns, in metres about it."""
    ring = np.arange(rows) % 32
    around = np.arange(rows) / rows * 2 * np.pi
    reach = 20 + 15 * np.sin(3 * around)
    height = np.tan(np.radians(-30 + 40 * ring / 31)) * reach
    bright = np.random.default_rng(5).uniform(0, 1, rows)
    return np.column_stack([reach * np.cos(around), reach * np.sin(around), height, bright, ring]).astype("<f4")


@pytest.mark.parametrize("rows", [3960, 3961, 3962])
@pytest.mark.parametrize("width", [4, 5])
def test_lidar_sweeps_get_up_and_view_from_their_sensor(
    tmp_path: Path, width: int, rows: int
) -> None:
    table = np.ascontiguousarray(sweep(rows)[:, :width])
    path = tmp_path / "000001.bin"
    path.write_bytes(table.tobytes())
    [cloud] = Sweeps().read(path)
    assert np.array_equal(cloud.points, table[:, :3])
    assert (cloud.up, cloud.up_certain) == ("+Z", True)
    assert cloud.sensor is not None and not cloud.sensor.position.any()
    assert np.array_equal(cloud.sensor.rotation @ [0, 0, 1], [1, 0, 0])  # ahead is +X
    assert np.array_equal(cloud.sensor.rotation @ [0, 1, 0], [0, 0, -1])


def test_folders_skip_bin_files_that_are_no_sweeps(tmp_path: Path) -> None:
    sweep = np.column_stack([cloud(40), np.full(40, 0.5)]).astype("<f4")
    (tmp_path / "000.bin").write_bytes(sweep.tobytes())
    (tmp_path / "weights.bin").write_bytes(np.random.default_rng(0).bytes(640))
    (tmp_path / "odd.bin").write_bytes(b"abc")
    (tmp_path / "empty.bin").write_bytes(b"")
    skipped: list[str] = []
    paths = find_scans([str(tmp_path)], False, lambda path: skipped.append(path.name))
    assert [path.name for path in paths] == ["000.bin"] and sorted(skipped) == ["empty.bin", "odd.bin", "weights.bin"]
    assert len(find_scans([str(tmp_path)], False, named=True)) == 4
    assert len(find_scans([str(tmp_path / "odd.bin")], False)) == 1
