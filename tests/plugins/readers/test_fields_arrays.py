"""Arrays: fields of records, of further columns, and of arrays beside the points, in npy, npz and HDF5."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_files import read_fields

from z2p_core.interfaces import RawCloud
from z2p_renderer.plugins.readers import numpy_arrays

COUNT = 90
RNG = np.random.default_rng(1)
POINTS = RNG.normal(size=(COUNT, 3)).astype("f4")
COLORS = RNG.integers(0, 256, (COUNT, 3)).astype("u1")
LABELS = RNG.integers(0, 9, COUNT)
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)


def read(path: Path, *wanted: str) -> RawCloud:
    [cloud] = read_fields(path, wanted or None)
    return cloud


def has_colors(cloud: RawCloud, colors: np.ndarray = COLORS / 255) -> bool:
    return bool(np.allclose(cloud.fields["rgb"], colors, atol=1e-6))


def test_records_keep_their_fields(tmp_path: Path) -> None:
    table = np.zeros(COUNT, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("red", "u2"), ("green", "u2"), ("blue", "u2"),
                             ("label", "u1"), ("pair", "f4", 2), ("ok", "?"), ("name", "U3")])  # fmt: skip
    for names, values in (("xyz", POINTS), (("red", "green", "blue"), COLORS)):
        for name, column in zip(names, values.T, strict=True):
            table[name] = column
    table["label"], table["pair"], table["ok"] = LABELS, POINTS[:, :2], LABELS > 4
    np.save(tmp_path / "a.npy", table)
    cloud = read(tmp_path / "a.npy")
    assert cloud.field_names == ("rgb", "label", "pair_0", "pair_1", "ok") and has_colors(cloud)
    assert np.array_equal(cloud.fields["label"], LABELS) and np.array_equal(cloud.fields["ok"], LABELS > 4)
    assert np.array_equal(cloud.fields["pair_1"], POINTS[:, 1]) and np.array_equal(cloud.points, POINTS.astype("f8"))


@pytest.mark.parametrize("key", ["rgb", "colors", "colours", "color"])
@pytest.mark.parametrize("kind", ["u1", "f4", "u2"])
def test_arrays_beside_the_points_of_an_npz(tmp_path: Path, key: str, kind: str) -> None:
    full = {"u1": 255, "f4": 1, "u2": 65535}[kind]
    shares = {"u1": COLORS / 255, "f4": COLORS / 255, "u2": RNG.integers(0, 65536, (COUNT, 3)) / 65535}[kind]
    arrays = {key: np.rint(shares * full).astype(kind) if full > 1 else shares.astype(kind), "normals": NORMALS,
              "labels": LABELS, "confidence": POINTS[:, :1] ** 2, "K": np.eye(3), "name": np.array(["x"])}  # fmt: skip
    np.savez(tmp_path / "a.npz", points=POINTS, **arrays)
    cloud = read(tmp_path / "a.npz")
    assert set(cloud.field_names) == {"rgb", "normal", "labels", "confidence"} and has_colors(cloud, shares)
    np.testing.assert_allclose(cloud.fields["normal"], NORMALS)
    assert np.array_equal(cloud.fields["labels"], LABELS)
    assert np.array_equal(cloud.fields["confidence"], POINTS[:, 0] ** 2)
    assert list(read(tmp_path / "a.npz", "labels").fields) == ["labels"]


def test_point_es_channels_are_colors(tmp_path: Path) -> None:
    red, green, blue = (COLORS / 255).astype("f4").T
    np.savez(tmp_path / "a.npz", coords=POINTS, R=red, G=green, B=blue, A=np.ones(COUNT, "f4"))
    cloud = read(tmp_path / "a.npz")
    assert has_colors(cloud) and cloud.field_names == ("rgb", "A")


@pytest.mark.parametrize(("columns", "names"), [
    ((COLORS,), ("rgb",)), ((COLORS / 255,), ("rgb",)), ((NORMALS,), ("normal",)),
    ((NORMALS, COLORS), ("normal", "rgb")), ((COLORS, LABELS), ("rgb", "column 7")), ((LABELS,), ("column 4",)),
])  # fmt: skip
def test_plain_arrays_of_more_columns(tmp_path, columns, names) -> None:
    np.save(tmp_path / "a.npy", np.column_stack([POINTS, *columns]))
    cloud = read(tmp_path / "a.npy")
    assert cloud.field_names == names and np.array_equal(cloud.points, POINTS.astype("f8"))
    assert "rgb" not in names or has_colors(cloud)


def test_batches_keep_the_fields_of_each_cloud(tmp_path: Path) -> None:
    points, colors = POINTS.reshape(3, 30, 3), COLORS.reshape(3, 30, 3)
    np.savez(tmp_path / "a.npz", points=points, colors=colors, label=np.arange(3), seg=LABELS.reshape(3, 30))
    clouds = read_fields(tmp_path / "a.npz")
    for index, cloud in enumerate(clouds):
        assert cloud.field_names == ("rgb", "seg") and has_colors(cloud, colors[index] / 255)
        assert np.array_equal(cloud.fields["seg"], LABELS.reshape(3, 30)[index])
    np.save(tmp_path / "a.npy", np.concatenate([points, colors], axis=2))
    for index, cloud in enumerate(read_fields(tmp_path / "a.npy")):
        assert has_colors(cloud, colors[index] / 255)


@pytest.mark.parametrize("first", [False, True])
def test_point_maps_take_their_picture(tmp_path: Path, first: bool) -> None:
    row, column = np.mgrid[:20, :24]
    depth = 2 + np.sin(row / 5) * np.cos(column / 7)
    points = np.stack([(column - 12) * depth / 20, (row - 10) * depth / 20, depth], axis=-1).astype("f4")
    picture = RNG.random((20, 24, 3)).astype("f4")
    confidence = RNG.random((20, 24)).astype("f4")
    given = np.moveaxis(picture, -1, 0) if first else picture
    np.savez(tmp_path / "a.npz", pts3d=points, image=given, conf=confidence)
    cloud = read(tmp_path / "a.npz")
    assert has_colors(cloud, picture.reshape(-1, 3))
    assert np.array_equal(cloud.fields["conf"], confidence.ravel())


def test_a_subsample_keeps_columns_and_points_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.save(tmp_path / "a.npy", np.column_stack([POINTS, COLORS, np.arange(COUNT)]).astype("f4"))
    monkeypatch.setattr(numpy_arrays.NumpyArrays, "max_rows", 30)
    cloud = read(tmp_path / "a.npy")
    rows = cloud.fields["column 7"].astype(int)
    assert cloud.total == COUNT and np.array_equal(cloud.points, POINTS[rows].astype("f8"))
    assert has_colors(cloud, COLORS[rows] / 255)


@pytest.mark.parametrize("group", ["", "scan/"])
def test_data_sets_beside_the_points(tmp_path: Path, group: str) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in {"points": POINTS, "rgb": COLORS, "label": LABELS, "other": np.eye(3)}.items():
            file[group + name] = values
        file["elsewhere/height"] = LABELS
    cloud = read(tmp_path / "a.h5")
    assert set(cloud.field_names) == {"rgb", "label"} and has_colors(cloud)
    assert np.array_equal(cloud.fields["label"], LABELS)


def test_labels_of_whole_objects_are_no_fields(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"], file["label"] = POINTS.reshape(3, 30, 3), np.arange(3)[:, None]
        file["pid"] = LABELS.reshape(3, 30)
        file["normal"] = NORMALS.reshape(3, 30, 3)
    for index, cloud in enumerate(read_fields(tmp_path / "a.h5")):
        assert set(cloud.field_names) == {"pid", "normal"}
        np.testing.assert_allclose(cloud.fields["normal"], NORMALS.reshape(3, 30, 3)[index])
