"""PCD: packed colors, labels, intensities and normals, in every encoding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pypcd4 import Encoding, PointCloud
from reader_files import read_fields

from z2p_core.interfaces import RawCloud

COUNT = 80
POINTS = np.random.default_rng(1).normal(size=(COUNT, 3)).astype("f4")
COLORS = np.random.default_rng(2).integers(0, 256, (COUNT, 3)).astype(np.uint32)
BITS = COLORS[:, 0] << 16 | COLORS[:, 1] << 8 | COLORS[:, 2]
INTENSITY = np.random.default_rng(3).random(COUNT).astype("f4")
LABELS = (np.arange(COUNT) * 7919 % 70000).astype("u4")
NORMALS = np.random.default_rng(4).normal(size=(COUNT, 3)).astype("f4")


def write(path: Path, encoding: str, alpha: int = 0, kind: str = "f4", name: str = "rgb", **fields) -> Path:
    """A file by the Point Cloud Library's Python sibling, with packed colors as `kind`."""
    packed = (BITS | np.uint32(alpha << 24)).view(kind)
    columns = dict(zip("xyz", POINTS.T, strict=True)) | {name: packed} | fields
    types = [values.dtype for values in columns.values()]
    PointCloud.from_points(list(columns.values()), tuple(columns), types).save(path, Encoding(encoding))
    return path


def read(path: Path, *wanted: str) -> RawCloud:
    [cloud] = read_fields(path, wanted or None)
    return cloud


@pytest.mark.parametrize("encoding", ["binary", "binary_compressed"])
@pytest.mark.parametrize(("kind", "alpha", "name"), [
    ("f4", 0, "rgb"), ("f4", 255, "rgba"), ("u4", 255, "rgba"), ("i4", 128, "rgb"), ("u4", 0, "rgb"),
])  # fmt: skip
def test_packed_colors_of_every_type(tmp_path, encoding, kind, alpha, name) -> None:
    cloud = read(write(tmp_path / "a.pcd", encoding, alpha, kind, name))
    np.testing.assert_allclose(cloud.fields["rgb"], COLORS / 255, atol=1e-6)
    assert cloud.field_names == ("rgb",) and cloud.color_kind == "8-bit, packed" and not cloud.note


@pytest.mark.parametrize("kind", ["U", "F"])
def test_packed_colors_in_text_are_integers_or_floats(tmp_path: Path, kind: str) -> None:
    head = f"VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F {kind}\nCOUNT 1 1 1 1\nWIDTH {COUNT}\nHEIGHT 1\n"
    head += f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {COUNT}\nDATA ascii\n"
    texts = [[str(bits) for bits in BITS], [repr(float(bits)) for bits in BITS.view("f4")]]
    for words in texts[: 1 if kind == "U" else 2]:
        rows = (" ".join([*map(repr, point), word]) for point, word in zip(POINTS.tolist(), words, strict=True))
        (tmp_path / "a.pcd").write_text(head + "\n".join(rows) + "\n")
        np.testing.assert_allclose(read(tmp_path / "a.pcd").fields["rgb"], COLORS / 255, atol=1e-6)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_scalars_labels_and_normals(tmp_path: Path, encoding: str) -> None:
    normals = dict(zip(("normal_x", "normal_y", "normal_z"), NORMALS.T, strict=True))
    path = write(tmp_path / "a.pcd", encoding, kind="u4", intensity=INTENSITY, label=LABELS, **normals)
    cloud = read(path)
    assert cloud.field_names == ("rgb", "intensity", "label", "normal")
    np.testing.assert_allclose(cloud.fields["rgb"], COLORS / 255, atol=1e-6)
    np.testing.assert_allclose(cloud.fields["intensity"], INTENSITY, rtol=1e-6)
    np.testing.assert_allclose(cloud.fields["normal"], NORMALS, rtol=1e-6)
    assert np.array_equal(cloud.fields["label"], LABELS) and cloud.fields["label"].dtype == np.uint32
    np.testing.assert_allclose(cloud.points, POINTS, rtol=1e-6)
    some = read(path, "label")
    assert list(some.fields) == ["label"] and some.field_names == cloud.field_names


@pytest.mark.parametrize("data", ["ascii", "binary"])
def test_fields_of_several_numbers(tmp_path: Path, data: str) -> None:
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("_", "u1", 3), ("pair", "<f4", 2), ("tag", "<u2")]
    rows = np.zeros(COUNT, kinds)
    for axis, values in zip("xyz", POINTS.T, strict=True):
        rows[axis] = values
    rows["pair"], rows["tag"] = NORMALS[:, :2], LABELS % 65536
    head = "VERSION 0.7\nFIELDS x y z _ pair tag\nSIZE 4 4 4 1 4 2\nTYPE F F F U F U\nCOUNT 1 1 1 3 2 1\n"
    head += f"WIDTH {COUNT}\nHEIGHT 1\nPOINTS {COUNT}\nDATA {data}\n"
    text = ((*POINTS[row].tolist(), 1, 2, 3, *NORMALS[row, :2].tolist(), rows["tag"][row]) for row in range(COUNT))
    body = "\n".join(" ".join(map(str, row)) for row in text).encode() if data == "ascii" else rows.tobytes()
    (tmp_path / "a.pcd").write_bytes(head.encode() + body)
    cloud = read(tmp_path / "a.pcd")
    assert cloud.field_names == ("pair_0", "pair_1", "tag")
    np.testing.assert_allclose(cloud.fields["pair_1"], NORMALS[:, 1], rtol=1e-6)
    assert np.array_equal(cloud.fields["tag"], rows["tag"])


@pytest.mark.parametrize("compressed", [False, True])
def test_what_open3d_writes_is_read(tmp_path: Path, compressed: bool) -> None:
    open3d = pytest.importorskip("open3d")
    written = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(POINTS.astype("f8")))
    written.colors = open3d.utility.Vector3dVector(COLORS / 255)
    for ascii in (False, True):
        open3d.io.write_point_cloud(str(tmp_path / "a.pcd"), written, write_ascii=ascii, compressed=compressed)
        np.testing.assert_allclose(read(tmp_path / "a.pcd").fields["rgb"], COLORS / 255, atol=1e-6)
