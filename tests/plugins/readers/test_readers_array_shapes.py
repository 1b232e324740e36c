"""Arrays other than points are recognized; point maps are seen from their camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from z2p_core import registry
from z2p_core.interfaces import RawCloud, ScanError
from z2p_renderer.plugins.readers.numpy_arrays import NumpyArrays
from z2p_renderer.storage.scans.clouds import read_clouds

RNG = np.random.default_rng(1)
XYZ = RNG.normal(size=(60, 3))
ROW, COLUMN = np.mgrid[:48, :64]
DEPTH = 2 + np.sin(ROW / 9) * np.cos(COLUMN / 7) / 3
SEEN = np.stack([(COLUMN - 31.5) / 60 * DEPTH, (ROW - 23.5) / 60 * DEPTH, DEPTH], -1)
"""What a camera sees in its own axes, OpenCV's."""
TURN = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))


def clouds(path: Path, **arrays: np.ndarray) -> list[RawCloud]:
    """What the reader gives for one array or for several under their names."""
    if set(arrays) == {"array"}:
        np.save(path.with_suffix(".npy"), arrays["array"])
        path = path.with_suffix(".npy")
    else:
        np.savez(path, **arrays)
    raw_clouds = NumpyArrays().read(path)
    assert all(isinstance(cloud, RawCloud) for cloud in raw_clouds)
    return raw_clouds  # type: ignore[return-value]


def looks(cloud: RawCloud) -> tuple[np.ndarray, np.ndarray]:
    assert cloud.sensor is not None
    assert np.linalg.det(cloud.sensor.rotation) == pytest.approx(1)
    return cloud.sensor.position, cloud.sensor.rotation


AXES = {"OpenCV": [1.0, 1.0, 1.0], "OpenGL": [1.0, -1.0, -1.0], "PyTorch3D": [-1.0, -1.0, 1.0]}


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("dtype", ["f4", "f8", "f2"])
@pytest.mark.parametrize("holes", [None, np.nan, 0.0])
def test_a_point_map_gets_the_sensor_of_its_camera(tmp_path: Path, axes: str, dtype: str, holes: float | None) -> None:
    seen = (SEEN * AXES[axes]).astype(dtype)
    if holes is not None:
        seen[5:20, 9:30] = holes
    (cloud,) = clouds(tmp_path / "a.npz", array=seen)
    position, rotation = looks(cloud)
    assert np.array_equal(cloud.points, seen.reshape(-1, 3).astype("f8"), equal_nan=True)
    assert not position.any() and np.allclose(rotation, np.diag(AXES[axes]), atol=1e-6)
    assert "48 x 64" in cloud.note


def test_a_noisy_point_map_is_upright(tmp_path: Path) -> None:
    seen = SEEN * (1 + RNG.normal(size=(48, 64, 1)) / 99) + RNG.normal(size=SEEN.shape) / 200
    _, rotation = looks(clouds(tmp_path / "a.npz", array=seen)[0])
    assert np.allclose(rotation, np.eye(3), atol=1e-6)


def test_a_point_map_of_a_camera_rotated_by_90_degrees(tmp_path: Path) -> None:
    position, rotation = looks(clouds(tmp_path / "a.npz", array=SEEN.swapaxes(0, 1)[:, ::-1])[0])
    assert not position.any() and np.allclose(rotation[:, 2], [0, 0, 1]) and np.allclose(rotation[:, 1], [1, 0, 0])


def test_a_point_map_in_world_axes_gives_its_camera_pose(tmp_path: Path) -> None:
    world = SEEN @ TURN.T + [5, -6, 70]
    for name, arrays in {"a": {"array": world}, "b": {"world_points": world, "world_points_conf": DEPTH}}.items():
        position, rotation = looks(clouds(tmp_path / f"{name}.npz", **arrays)[0])
        assert np.allclose(position, [5, -6, 70], atol=1e-6) and np.allclose(rotation, TURN, atol=1e-6)


@pytest.mark.parametrize("key", ["pts3d", "world_points", "points", "xyz", "point_map", "array"])
@pytest.mark.parametrize("first", ["last", "first"])
def test_point_maps_of_several_cameras_are_separate_clouds(tmp_path: Path, key: str, first: str) -> None:
    views = np.stack([SEEN, SEEN @ TURN.T + [1, 2, 3]])
    array = views if first == "last" else np.moveaxis(views, -1, 1)
    beside = {} if key == "array" else {"conf": np.ones((2, 48, 64)), "imgs": np.zeros((2, 48, 64, 3), "u1")}
    one, other = clouds(tmp_path / "a.npz", **{key: array.astype("f4")}, **beside)
    assert np.allclose(looks(one)[1], np.eye(3), atol=1e-5) and np.allclose(looks(other)[0], [1, 2, 3], atol=1e-3)
    assert np.allclose(other.points, views[1].reshape(-1, 3), atol=1e-5)
    (alone,) = clouds(tmp_path / "b.npz", **{key: array[0].astype("f4")}, **{k: a[0] for k, a in beside.items()})
    assert np.allclose(looks(alone)[1], np.eye(3), atol=1e-5)


@pytest.mark.parametrize(("depth", "camera"), [("depth", "K"), ("depths", "intrinsics")])
def test_a_depth_map_beside_its_cameras_matrix_is_a_point_map(tmp_path: Path, depth: str, camera: str) -> None:
    matrix = np.array([[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]])
    for values, matrices in ((DEPTH, matrix), (DEPTH[None, ..., None], matrix[None]), (DEPTH[None], matrix)):
        (cloud,) = clouds(tmp_path / "a.npz", **{depth: values, camera: matrices, "image": np.zeros((48, 64, 3), "u1")})
        assert np.allclose(cloud.points, SEEN.reshape(-1, 3)) and np.allclose(looks(cloud)[1], np.eye(3))
    for values, matrices, match in ((DEPTH[0], matrix, "depth map"), (DEPTH, matrix[0], "depth map"),
                                    (DEPTH, np.zeros((3, 3)), "focal lengths")):  # fmt: skip
        with pytest.raises(ScanError, match=match):
            clouds(tmp_path / "b.npz", **{depth: values, camera: matrices})


@pytest.mark.parametrize(
    ("array", "match"),
    [(DEPTH, "depth map or a grid of heights.*cx"), (np.tile(DEPTH, (1, 3)), "depth map.*cx"), (DEPTH[..., None], "cx"),
     (DEPTH[:, :12], "depth map"), (np.stack([ROW, COLUMN], -1), "depth map"), (RNG.random((30, 30)), "depth map"),
     ((DEPTH * 99).astype("u2")[:, :9], "depth map"), (np.zeros((48, 64, 3), "u1"), "colour picture"),
     (np.zeros((48, 64, 4), "u1"), "colour picture"),
     (np.rint(np.stack([DEPTH / 3] * 3, -1) * 255) / 255, "colour picture"),
     (np.eye(4), "pose"), (np.stack([np.eye(4)] * 9), "poses"), (np.stack([np.eye(4)[:3]] * 9), "poses"),
     (np.stack([TURN] * 9), "poses"), (np.tile(np.eye(4)[:3].ravel(), (9, 1)), "poses"), (XYZ.T, "transpose"),
     (np.stack([XYZ.T] * 2), "transpose"), (XYZ.astype("c16"), "dtype complex128"), (XYZ.astype("U9"), "dtype <U9"),
     (np.stack([XYZ, XYZ], -1), "expected"), (XYZ > 0, "dtype bool"), (np.zeros((9, 3), "M8[s]"), "dtype datetime64")],
    ids=lambda value: str(getattr(value, "shape", "")) + str(getattr(value, "dtype", "")),
)  # fmt: skip
def test_arrays_that_are_no_points_are_described(tmp_path: Path, array: np.ndarray, match: str) -> None:
    for name, arrays in {"a": {"array": array}, "b": {"points": array}}.items():
        with pytest.raises(ScanError, match=match) as caught:
            clouds(tmp_path / f"{name}.npz", **arrays)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("width", [3, 4, 6, 7, 9, 16, 40])
def test_rows_of_points_with_features_stay_points(tmp_path: Path, width: int) -> None:
    table = RNG.normal(size=(400, width)).astype("f4")
    table[:, 6:] = np.eye(max(width, 7))[RNG.integers(0, width, 400), 6:width]  # labels, one hot
    (cloud,) = clouds(tmp_path / "a.npz", array=table)
    assert np.array_equal(cloud.points, table[:, :3]) and cloud.sensor is None
    assert not cloud.note and len(cloud.field_names) == min(width - 3, 32)


def test_a_batch_stays_a_batch(tmp_path: Path) -> None:
    batch = RNG.normal(size=(40, 50, 3))
    for array in (batch, batch - batch.min() + 0.01, (batch - batch.min()) / np.ptp(batch)):
        raw_clouds = clouds(tmp_path / "a.npz", array=array)
        assert np.array_equal([cloud.points for cloud in raw_clouds], array)


@pytest.mark.parametrize("key", ["data", "complete_pcds", "incomplete_pcds", "gt", "pcds"])
def test_objects_of_data_sets_are_usually_y_up(tmp_path: Path, key: str) -> None:
    raw_clouds = clouds(tmp_path / "a.npz", **{key: RNG.normal(size=(4, 50, 3)), "labels": np.arange(4)})
    assert [(cloud.up, cloud.up_certain) for cloud in raw_clouds] == [("+Y", False)] * 4
    assert clouds(tmp_path / "b.npz", points=XYZ, labels=np.arange(60))[0].up == ""


def test_records_are_read_by_the_names_of_their_fields(tmp_path: Path) -> None:
    named = np.zeros(60, [("label", "i4"), ("xyz", "f4", (3,)), ("rgb", "u1", (3,))])
    named["xyz"] = XYZ
    (cloud,) = clouds(tmp_path / "a.npz", array=named)
    assert np.array_equal(cloud.points, XYZ.astype("f4"))
    for fields in ([("x", "U9"), ("y", "U9"), ("z", "U9")], [("x", "c8"), ("y", "f4"), ("z", "f4")],
                   [("u", "f4"), ("v", "f4"), ("w", "f4")], [("x", "f4", (2,)), ("y", "f4"), ("z", "f4")]):  # fmt: skip
        with pytest.raises(ScanError, match="expected records with numbers x, y and z, got dtype"):
            clouds(tmp_path / "b.npz", array=np.zeros(60, fields))


def test_arrays_from_python_2_are_read_without_warning(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    np.save(tmp_path / "a.npy", XYZ)
    blob = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(blob.replace(b"(60, 3), }", b"(60L, 3),}"))
    (scan,) = read_clouds(tmp_path / "a.npy")
    assert np.array_equal(scan.points, XYZ) and not recwarn.list


def test_an_array_cut_short_inside_an_archive_is_refused(tmp_path: Path) -> None:
    assert registry.load("readers", "numpy") is NumpyArrays
    np.save(tmp_path / "a.npy", np.asfortranarray(XYZ))
    assert np.array_equal(NumpyArrays().read(tmp_path / "a.npy")[0].points, XYZ)  # type: ignore[union-attr]
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-8])
    with pytest.raises(ScanError, match="cut short"):
        NumpyArrays().read(tmp_path / "a.npy")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("width", [3, 12])
def test_signaling_nan_gives_no_warning(tmp_path: Path, width: int) -> None:
    rows = np.random.default_rng(0).normal(size=(40, width)).astype("<f4")
    rows.view("<u4")[3] = 0x7FA00000
    np.save(tmp_path / "a.npy", rows)
    (scan,) = read_clouds(tmp_path / "a.npy")
    assert len(scan.points) == 39 and scan.dropped == 1


@pytest.mark.parametrize(
    ("before", "message"),
    [(np.arange(60)[:, None], r"column 1 may be numbers .* array\[:, 1:4\]"),
     (np.column_stack([np.arange(60) // 8, np.arange(60) % 8]), r"row and column numbers .* array\[:, 2:5\]"),
     (XYZ / np.linalg.norm(XYZ, axis=1)[:, None], r"columns 1 to 3 may be normals .* array\[:, 3:6\]"),
     (1.6e9 + np.arange(60)[:, None] / 10, r"column 1 may be times")],
)  # fmt: skip
def test_array_with_other_leading_columns_is_refused(
    tmp_path: Path, before: np.ndarray, message: str
) -> None:
    with pytest.raises(ScanError, match=message):
        clouds(tmp_path / "a", array=np.column_stack([before, XYZ]))
    assert np.array_equal(clouds(tmp_path / "b", array=np.column_stack([XYZ, before]))[0].points, XYZ)
