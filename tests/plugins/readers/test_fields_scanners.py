"""PTX, sweeps of a car's lidar, and COLMAP's binary points: colors, intensities and further fields."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from reader_files import read_fields

from z2p_core.interfaces import RawCloud

COUNT = 60
RNG = np.random.default_rng(1)
POINTS = RNG.normal(size=(COUNT, 3)).round(5)
COLORS = RNG.integers(0, 256, (COUNT, 3))
INTENSITY = RNG.random(COUNT).round(5)


def read(path: Path, *wanted: str) -> RawCloud:
    [cloud] = read_fields(path, wanted or None)
    return cloud


def scan(rows: np.ndarray) -> str:
    head = [str(len(rows)), "1", "0 0 0", "1 0 0", "0 1 0", "0 0 1", "1 0 0 0", "0 1 0 0", "0 0 1 0", "5 6 7 1"]
    return "\n".join([*head, *(" ".join(f"{number:g}" for number in row) for row in rows)]) + "\n"


@pytest.mark.parametrize("lines", [7, 200_000])
def test_ptx_fields_lose_the_cells_without_a_point(tmp_path, lines, monkeypatch) -> None:
    monkeypatch.setattr("z2p_renderer.plugins.readers.ptx._BLOCK_LINES", lines)
    table = np.column_stack([POINTS, INTENSITY, COLORS])
    empty = RNG.random(COUNT) < 0.3
    table[empty, :3] = 0
    path = tmp_path / "a.ptx"
    path.write_text(scan(table) + scan(table[:, :4]))
    cloud, kept = read(path), ~empty
    first = cloud.fields["rgb"][: kept.sum()]
    np.testing.assert_allclose(first, COLORS[kept] / 255, atol=1e-6)
    assert np.isnan(cloud.fields["rgb"][kept.sum() :]).all()
    np.testing.assert_allclose(cloud.fields["intensity"], np.tile(INTENSITY[kept], 2), atol=1e-6)
    np.testing.assert_allclose(cloud.points[: kept.sum()], POINTS[kept] + (5, 6, 7), atol=1e-4)
    path.write_text(scan(table[:, :4]))
    assert read(path).field_names == ("intensity",) and list(read(path, "rgb").fields) == []


def test_sweeps_have_intensities_and_rings(tmp_path: Path) -> None:
    rings = RNG.integers(0, 32, COUNT)
    table = np.column_stack([40 * POINTS, INTENSITY, rings]).astype("<f4")
    (tmp_path / "a.pcd.bin").write_bytes(table.tobytes())
    cloud = read(tmp_path / "a.pcd.bin")
    assert np.array_equal(cloud.fields["ring"], rings) and cloud.fields["ring"].dtype.kind == "i"
    assert np.array_equal(cloud.fields["intensity"], table[:, 3])


def test_named_columns_of_a_bin_are_fields(tmp_path: Path) -> None:
    table = np.column_stack([POINTS, COLORS, np.arange(COUNT)]).astype("<f4")
    (tmp_path / "a.bin").write_bytes(table.tobytes())
    [cloud] = read_fields(tmp_path / "a.bin", None, ("x", "y", "z", "r", "g", "b", "label"))
    np.testing.assert_allclose(cloud.fields["rgb"], COLORS / 255, atol=1e-6)
    assert np.array_equal(cloud.fields["label"], np.arange(COUNT))


def test_colmaps_binary_points_have_colors_and_tracks(tmp_path: Path) -> None:
    tracks = RNG.integers(0, 6, COUNT)
    blob = struct.pack("<Q", COUNT)
    for row, length in enumerate(tracks.tolist()):
        blob += struct.pack("<Q3d3Bd", row + 7, *POINTS[row], *COLORS[row].tolist(), INTENSITY[row])
        blob += struct.pack("<Q", length) + bytes(8 * length)
    (tmp_path / "points3D.bin").write_bytes(blob)
    cloud = read(tmp_path / "points3D.bin")
    np.testing.assert_allclose(cloud.fields["rgb"], COLORS / 255, atol=1e-6)
    assert np.array_equal(cloud.fields["track_length"], tracks) and np.array_equal(cloud.points, POINTS)
    assert np.array_equal(cloud.fields["error"], INTENSITY) and cloud.units == {"error": "px"}
    assert np.array_equal(cloud.fields["point3d_id"], np.arange(COUNT) + 7)
    assert list(read(tmp_path / "points3D.bin", "rgb").fields) == ["rgb"]
