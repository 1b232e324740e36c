"""Up and view of a PLY file beside which the cameras lie that it was made from."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from z2p_core.interfaces import RawCloud
from z2p_renderer.plugins.readers.ply import Ply

POINTS = np.random.default_rng(8).normal(size=(50, 3)).astype("<f4")
TILTED = np.array([0.0, 0.6, 0.8])


def cloud_of(path: Path) -> RawCloud:
    """What is read of a file that is written there first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    head = "".join(f"property float {name}\n" for name in "xyz")
    path.write_bytes(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(POINTS)}\n{head}end_header\n".encode()
                     + POINTS.tobytes())  # fmt: skip
    [cloud] = Ply().read(path)
    assert np.array_equal(cloud.points, POINTS)
    return cloud


def around(up: np.ndarray, count: int = 6) -> list[tuple[np.ndarray, np.ndarray]]:
    """Axes (right, down, ahead, as columns) and places of cameras that stand around the origin and look down at it."""
    side = np.linalg.svd(up[None])[2][1:]
    cameras = []
    for angle in np.linspace(0, 5, count):
        place = 4 * (np.cos(angle) * side[0] + np.sin(angle) * side[1]) + 2 * up
        ahead = -place / np.linalg.norm(place)
        right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
        cameras.append((np.column_stack([right, np.cross(ahead, right), ahead]), place))
    return cameras


def images(folder: Path, up: np.ndarray) -> None:
    """An images.bin of cameras none of which shows a point."""
    rows = [struct.pack("<Q", 6)]
    for number, (axes, place) in enumerate(around(up)):
        w, x, y, z = quaternion(axes.T)
        rows.append(struct.pack("<I7dI", number, w, x, y, z, *(-axes.T @ place), 1) + b"a.jpg\0" + struct.pack("<Q", 0))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "images.bin").write_bytes(b"".join(rows))


def quaternion(rotation: np.ndarray) -> list[float]:
    """w, x, y, z: the turn about the axis that a rotation keeps."""
    values, vectors = np.linalg.eig(rotation)
    axis = np.real(vectors[:, np.abs(values - 1).argmin()])
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    half = np.arctan2(skew @ axis, np.trace(rotation) - 1) / 2
    return [float(np.cos(half)), *(np.sin(half) * axis).tolist()]


def transforms(folder: Path, up: np.ndarray, **more: Any) -> None:
    """A transforms.json of the same cameras."""
    frames = []
    for axes, place in around(up):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = axes * [1, -1, -1], place
        frames.append({"file_path": "a.jpg", "transform_matrix": matrix.tolist()})
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "transforms.json").write_text(json.dumps({"frames": frames, **more}))


@pytest.mark.parametrize("name, model", [("sparse/0/points3D.ply", "sparse/0"), ("dense/fused.ply", "dense/sparse"),
                                         ("dense/meshed-poisson.ply", "dense/sparse")])  # fmt: skip
def test_colmap_cameras_give_up_to_its_dense_clouds(tmp_path: Path, name: str, model: str) -> None:
    images(tmp_path / model, TILTED)
    cloud = cloud_of(tmp_path / name)
    assert (cloud.up, cloud.up_certain) == ("+Z", True) and "6 cameras" in cloud.up_reason
    assert cloud.upward is not None and np.allclose(cloud.upward, TILTED) and cloud.seen_from is not None


def test_a_fused_cloud_alone_gets_uncertain_colmap_axes(tmp_path: Path) -> None:
    fused, other = cloud_of(tmp_path / "fused.ply"), cloud_of(tmp_path / "refused.ply")
    assert (fused.up, fused.up_certain, other.up) == ("-Y", False, "")


def test_damaged_colmap_cameras_are_ignored(tmp_path: Path) -> None:
    for blob in (b"", b"\xff" * 99, b"\0" * 8):
        (tmp_path / "images.bin").write_bytes(blob)
        assert cloud_of(tmp_path / "a.ply").up == ""


def test_transforms_json_gives_up_to_its_named_cloud(tmp_path: Path) -> None:
    transforms(tmp_path, TILTED, ply_file_path="./points/sparse_pc.ply")
    cloud = cloud_of(tmp_path / "sparse_pc.ply")
    assert (cloud.up, cloud.up_certain) == ("+Z", True)
    assert cloud.upward is not None and np.allclose(cloud.upward, TILTED) and cloud.seen_from is not None


@pytest.mark.parametrize("up, axis", [((0, 1, 0), "+Y"), ((0, 0, 1), "+Z"), ((-1, 0, 0), "-X"), ((0, -1, 0), "-Y")])
def test_cameras_only_suggest_up_for_other_clouds_nearby(tmp_path: Path, up: Any, axis: str) -> None:
    transforms(tmp_path, np.array(up, dtype=float), ply_file_path="other.ply")
    cloud = cloud_of(tmp_path / "a.ply")
    assert (cloud.up, cloud.up_certain, cloud.upward, cloud.seen_from) == (axis, False, None, None)


@pytest.mark.parametrize(
    "turn, axis",
    [(None, "+Z"), ([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], "+Z"),
     ([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]], "-X"), (np.eye(4).tolist(), "-Y"), ("none", "+Z"), ([[1]], "+Z")],
)  # fmt: skip
def test_without_cameras_the_applied_transform_gives_up(tmp_path: Path, turn: Any, axis: str) -> None:
    more = {} if turn is None else {"applied_transform": turn}
    transforms(tmp_path, TILTED, **more)
    every = json.loads((tmp_path / "transforms.json").read_text())
    flip = np.diag([1.0, -1, -1, 1])
    every["frames"] += [{"transform_matrix": (flip @ frame["transform_matrix"]).tolist()} for frame in every["frames"]]
    every["frames"] += [{"transform_matrix": (np.diag([-1, 1, -1, 1.0]) @ frame["transform_matrix"]).tolist()}
                        for frame in every["frames"]]  # fmt: skip
    (tmp_path / "transforms.json").write_text(json.dumps(every))
    cloud = cloud_of(tmp_path / "a.ply")
    assert (cloud.up, cloud.up_certain) == (axis, False) and "nerfstudio" in cloud.up_reason


@pytest.mark.parametrize("matrix", [3, [[1, 2], [3]], [[float("nan"), 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], None,
                                    [[0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], [["a"] * 4] * 4])  # fmt: skip
def test_invalid_cameras_leave_nerfstudios_default_axes(tmp_path: Path, matrix: Any) -> None:
    for frames in ([{"transform_matrix": matrix}], [], [{}], [matrix]):
        (tmp_path / "transforms.json").write_text(json.dumps({"frames": frames, "ply_file_path": "a.ply"}))
        cloud = cloud_of(tmp_path / "a.ply")
        assert (cloud.up, cloud.up_certain, cloud.seen_from) == ("+Z", False, None)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "{}", '{"frames": 3}', "[" * 100_000, "\x00"])
def test_a_damaged_transforms_file_is_ignored(tmp_path: Path, text: str) -> None:
    (tmp_path / "transforms.json").write_text(text)
    assert cloud_of(tmp_path / "a.ply").up == ""


def test_initial_points_of_a_splat_model_use_its_cameras_up(tmp_path: Path) -> None:
    cameras = [{"position": place.tolist(), "rotation": axes.tolist()} for axes, place in around(TILTED)]
    (tmp_path / "cameras.json").write_text(json.dumps(cameras))
    initial_cloud, other = cloud_of(tmp_path / "input.ply"), cloud_of(tmp_path / "a.ply")
    assert (initial_cloud.up, initial_cloud.up_certain, other.up) == ("+Z", True, "")
