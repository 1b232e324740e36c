"""Readers that read in blocks give the same points, colors and order for any size of a block."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from pypcd4 import Encoding, PointCloud

from z2p_core.formats import row_subsampling
from z2p_renderer.plugins.readers import las
from z2p_renderer.plugins.readers._pcd import binary as pcd_binary
from z2p_renderer.plugins.readers.e57 import E57
from z2p_renderer.plugins.readers.las import Las
from z2p_renderer.plugins.readers.pcd import Pcd

COUNT = 200
ROWS = np.arange(COUNT)
POINTS = np.stack([ROWS, ROWS % 7, ROWS % 11], axis=1) + 1.0


def write_pcd(path: Path, encoding: Encoding) -> None:
    columns = [*POINTS.T.astype(np.float32), (ROWS << 16).astype(np.uint32).view(np.float32)]
    PointCloud.from_points(columns, ("x", "y", "z", "rgb"), (np.float32,) * 4).save(str(path), encoding=encoding)


def write_las(path: Path) -> None:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales = [0.5] * 3
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = POINTS.T
    cloud.red = cloud.green = cloud.blue = (ROWS * 257).astype(np.uint16)
    cloud.intensity = ROWS.astype(np.uint16)
    cloud.write(str(path))


def write_e57(path: Path) -> None:
    library = pytest.importorskip("pye57")
    file = library.E57(str(path), mode="w")
    names = ("cartesianX", "cartesianY", "cartesianZ")
    file.write_scan_raw({**dict(zip(names, POINTS.T.copy(), strict=True)), "intensity": ROWS.astype(float)})
    file.close()


@pytest.mark.parametrize("encoding", [Encoding.BINARY, Encoding.BINARY_COMPRESSED, Encoding.ASCII])
def test_pcd_does_not_depend_on_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, encoding: Encoding) -> None:
    write_pcd(tmp_path / "a.pcd", encoding)
    monkeypatch.setattr(row_subsampling, "BLOCK_BYTES", 100)
    monkeypatch.setattr("z2p_renderer.plugins.readers.pcd._BLOCK_CHARACTERS", 50)
    (cloud,) = Pcd().read(tmp_path / "a.pcd")
    np.testing.assert_array_equal(cloud.points, POINTS)
    if encoding != Encoding.ASCII:  # the library writes so small floats as 0 in text
        np.testing.assert_allclose(cloud.fields["rgb"][:, 0], ROWS / 255)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("chunk", [7, 64, 1000])
def test_las_does_not_depend_on_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, chunk: int
) -> None:
    write_las(tmp_path / f"a{suffix}")
    monkeypatch.setattr(las, "_CHUNK_POINTS", chunk)
    reader = Las()
    reader.wanted = None
    (cloud,) = reader.read(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(cloud.points, POINTS)
    np.testing.assert_array_equal(cloud.fields["intensity"], ROWS)
    np.testing.assert_allclose(cloud.fields["rgb"][:, 0], ROWS * 257 / 65535, atol=1e-6)


def test_unwanted_layers_of_laz_are_not_needed_for_the_rest(tmp_path: Path) -> None:
    write_las(tmp_path / "a.laz")
    reader = Las()
    reader.wanted = ()
    (cloud,) = reader.read(tmp_path / "a.laz")
    np.testing.assert_array_equal(cloud.points, POINTS)
    assert not cloud.fields


def test_e57_does_not_depend_on_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_e57(tmp_path / "a.e57")
    monkeypatch.setattr(row_subsampling, "BLOCK_BYTES", 300)
    reader = E57()
    reader.wanted = None
    (cloud,) = reader.read(tmp_path / "a.e57")
    np.testing.assert_allclose(cloud.points, POINTS)
    np.testing.assert_allclose(cloud.fields["intensity"], ROWS)


@pytest.mark.parametrize("encoding", [Encoding.BINARY, Encoding.BINARY_COMPRESSED])
def test_a_pcd_of_very_many_points_is_subsampled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, encoding: Encoding
) -> None:
    write_pcd(tmp_path / "a.pcd", encoding)
    monkeypatch.setattr(Pcd, "max_rows", 50)
    (cloud,) = Pcd().read(tmp_path / "a.pcd")
    rows = cloud.points[:, 0].astype(int) - 1
    assert cloud.total == COUNT
    np.testing.assert_array_equal(rows // 4, np.arange(50))
    np.testing.assert_allclose(cloud.fields["rgb"][:, 0], rows / 255)


def test_row_types_hold_fields_of_several_numbers() -> None:
    row = pcd_binary.row_dtype(["x", "h"], ["f4", "u1"], [1, 3])
    assert (row.itemsize, row["h"].shape) == (7, (3,))
