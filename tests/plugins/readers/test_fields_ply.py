"""PLY: colors, normals and scalars of each vertex, in every encoding and under every writer's names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_files import read_fields

from z2p_core.interfaces import RawCloud
from z2p_renderer.plugins.readers import ply

COUNT = 60
POINTS = np.random.default_rng(1).normal(size=(COUNT, 3)).astype("f4")
BYTES = np.random.default_rng(2).integers(0, 256, (COUNT, 3))
SHORTS = np.random.default_rng(3).integers(0, 65536, (COUNT, 3))
SHARES = np.random.default_rng(4).random((COUNT, 3)).astype("f4")
PLY_NAMES = {"u1": "uchar", "u2": "ushort", "f4": "float", "f8": "double", "i4": "int", "i2": "short"}
ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")
RGB = ("red", "green", "blue")


def write(path: Path, encoding: str = ENCODINGS[1], **columns: tuple[str, np.ndarray]) -> Path:
    """A file of points with further properties, each of a type: ``label=("i4", values)``."""
    columns = {axis: ("f4", values) for axis, values in zip("xyz", POINTS.T, strict=True)} | columns
    order = ">" if "big" in encoding else "<"
    table = np.zeros(len(POINTS), [(name, order + kind) for name, (kind, _) in columns.items()])
    for name, (_, values) in columns.items():
        table[name] = values
    properties = "".join(f"property {PLY_NAMES[kind]} {name}\n" for name, (kind, _) in columns.items())
    head = f"ply\nformat {encoding} 1.0\nelement vertex {len(POINTS)}\n{properties}end_header\n".encode()
    rows = "".join(" ".join(map(repr, row)) + "\n" for row in table.tolist()).encode()
    path.write_bytes(head + (rows if encoding == "ascii" else table.tobytes()))
    return path


def of(names: tuple[str, ...], kind: str, table: np.ndarray) -> dict[str, tuple[str, np.ndarray]]:
    return {name: (kind, values) for name, values in zip(names, table.T, strict=True)}


def read(path: Path, wanted: tuple[str, ...] | None = None) -> RawCloud:
    [cloud] = read_fields(path, wanted)
    return cloud


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(("kind", "table", "scale", "told"), [
    ("u1", BYTES, 255, "8-bit"), ("u2", SHORTS, 65535, "16-bit"), ("f4", SHARES, 1, "shares of 1"),
    ("u2", BYTES, 255, "8-bit, in 16-bit integers"), ("f4", BYTES, 255, "8-bit"),
])  # fmt: skip
def test_colors_of_every_type(tmp_path, encoding, kind, table, scale, told) -> None:
    cloud = read(write(tmp_path / "a.ply", encoding, **of(RGB, kind, table)))
    np.testing.assert_allclose(cloud.fields["rgb"], table / scale, atol=1e-6)
    assert cloud.color_kind == told and cloud.field_names == ("rgb",) and not cloud.note
    assert np.array_equal(cloud.points, POINTS.astype("f8"))


@pytest.mark.parametrize("names", [("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue")])
def test_colors_of_other_names(tmp_path: Path, names: tuple[str, ...]) -> None:
    cloud = read(write(tmp_path / "a.ply", **of(names, "u1", BYTES)))
    np.testing.assert_allclose(cloud.fields["rgb"], BYTES / 255, atol=1e-6)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_normals_and_scalars_come_by_name(tmp_path: Path, encoding: str) -> None:
    labels = np.arange(COUNT) - 5
    times = 1.6e9 + np.arange(COUNT) / 1000
    path = write(tmp_path / "a.ply", encoding, **of(("nx", "ny", "nz"), "f4", SHARES), **of(RGB, "u1", BYTES),
                 alpha=("u1", BYTES[:, 0]), scalar_Label=("i4", labels), time=("f8", times))  # fmt: skip
    cloud = read(path)
    assert cloud.field_names == ("normal", "rgb", "alpha", "scalar_Label", "time")
    np.testing.assert_allclose(cloud.fields["normal"], SHARES, atol=1e-7)
    assert np.array_equal(cloud.fields["scalar_Label"], labels) and cloud.fields["scalar_Label"].dtype == np.int32
    assert np.array_equal(cloud.fields["time"], times)
    some = read(path, ("SCALAR_LABEL",))
    assert list(some.fields) == ["scalar_Label"] and some.field_names == cloud.field_names


def test_a_subsample_keeps_rows_and_fields_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "a.ply", **of(RGB, "u1", BYTES), number=("i4", np.arange(COUNT)))
    monkeypatch.setattr(ply.Ply, "max_rows", 20)
    cloud = read(path)
    rows = cloud.fields["number"]
    assert cloud.total == COUNT and len(rows) == 20
    assert np.array_equal(cloud.points, POINTS[rows].astype("f8"))
    np.testing.assert_allclose(cloud.fields["rgb"], BYTES[rows] / 255, atol=1e-6)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_fields_beside_a_list_of_the_vertex(tmp_path: Path, encoding: str) -> None:
    order = ">" if "big" in encoding else "<"
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    head = (f"ply\nformat {encoding} 1.0\nelement vertex {COUNT}\n{axes}"
            "property list uchar int seen\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n")
    rows = []
    for index, (point, color) in enumerate(zip(POINTS, BYTES, strict=True)):
        seen = list(range(index % 3))
        if encoding == "ascii":
            rows.append(" ".join(map(repr, [*point.tolist(), len(seen), *seen, *color.tolist()])).encode() + b"\n")
        else:
            rows.append(point.astype(f"{order}f4").tobytes() + bytes([len(seen)])
                        + np.array(seen, f"{order}i4").tobytes() + bytes(color.tolist()))  # fmt: skip
    (tmp_path / "a.ply").write_bytes(head.encode() + b"".join(rows))
    cloud = read(tmp_path / "a.ply")
    assert np.array_equal(cloud.points, POINTS.astype("f8")) and cloud.field_names == ("rgb",)
    np.testing.assert_allclose(cloud.fields["rgb"], BYTES / 255, atol=1e-6)


def test_numbers_that_are_no_colors_are_none(tmp_path: Path) -> None:
    cloud = read(write(tmp_path / "a.ply", **of(RGB, "i2", BYTES - 20)))
    assert not cloud.fields and not cloud.field_names
    assert cloud.note == "its colours are no numbers from 0 to 65535, and are not taken"
    black = read(write(tmp_path / "a.ply", **of(RGB, "u1", 0 * BYTES)))
    assert not black.fields and black.note == "all its colours are 0, and taken as none"


def test_what_open3d_writes_is_read(tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d")
    written = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(POINTS.astype("f8")))
    written.colors = open3d.utility.Vector3dVector(BYTES / 255)
    written.normals = open3d.utility.Vector3dVector(SHARES.astype("f8"))
    for ascii in (True, False):
        open3d.io.write_point_cloud(str(tmp_path / "a.ply"), written, write_ascii=ascii)
        cloud = read(tmp_path / "a.ply")
        np.testing.assert_allclose(cloud.fields["rgb"], BYTES / 255, atol=1e-6)
        np.testing.assert_allclose(cloud.fields["normal"], SHARES, atol=1e-6)
