"""COLMAP's models: their points, and up and view from the cameras beside them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from z2p_core.interfaces import RawCloud, ScanError
from z2p_renderer.plugins.readers.raw_lidar import Sweeps
from z2p_renderer.storage.scans.clouds import find_scans, read_clouds

POINTS = np.random.default_rng(1).normal(size=(60, 3))
TILTED = np.array([0.6, 0.0, 0.8])


def points3d(points: np.ndarray = POINTS) -> bytes:
    """Points with a track of 0 to 4 pictures each."""
    rows = [struct.pack("<Q3d3BdQ", index, *point, 1, 2, 3, 0.5, index % 5) + bytes(8 * (index % 5))
            for index, point in enumerate(points.tolist())]  # fmt: skip
    return struct.pack("<Q", len(rows)) + b"".join(rows)


def quaternion(rotation: np.ndarray) -> list[float]:
    """w, x, y and z of a rotation matrix, by the eigenvector that holds for all of them (Bar-Itzhack)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    matrix = np.array([[a - e - i, b + d, c + g, h - f], [b + d, e - a - i, f + h, c - g],
                       [c + g, f + h, i - a - e, d - b], [h - f, c - g, d - b, a + e + i]])  # fmt: skip
    x, y, z, w = np.linalg.eigh(matrix)[1][:, -1].tolist()
    return [w, x, y, z]


def poses(up: np.ndarray, arc: float = 120.0, height: float = 1.0, count: int = 9) -> list[list[float]]:
    """Quaternions and shifts of cameras on an arc about the origin that look down at it and are not rolled."""
    ahead = np.cross(up, [0.3, 0.5, -0.2])
    ahead /= np.linalg.norm(ahead)
    aside = np.cross(up, ahead)
    pose_rows = []
    for angle in np.radians(np.linspace(-arc / 2, arc / 2, count)):
        place = 4 * (np.cos(angle) * ahead + np.sin(angle) * aside) + height * up
        forward = -place / np.linalg.norm(place)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        pose_rows.append([*quaternion(rotation), *(-rotation @ place).tolist()])
    return pose_rows


def images_bin(pose_rows: list[list[float]]) -> bytes:
    rows = [struct.pack("<I7dI", number, *pose, 1) + f"{number}.jpg\0".encode() + struct.pack("<Q", number) +
            bytes(24 * number) for number, pose in enumerate(pose_rows)]  # fmt: skip
    return struct.pack("<Q", len(rows)) + b"".join(rows)


def images_txt(pose_rows: list[list[float]]) -> str:
    marks = ("1.5 2.5 -1 3.5 4.5 7\n", "\n")
    rows = [f"{number} {' '.join(map(repr, pose))} 1 {number}.jpg\n{marks[number % 2]}"
            for number, pose in enumerate(pose_rows)]  # fmt: skip
    return "# Image list with two lines of data per image:\n" + "".join(rows)


def model(folder: Path, images: str | bytes | None = None) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "points3D.bin").write_bytes(points3d())
    (folder / "cameras.bin").write_bytes(struct.pack("<QIIQQ3d", 1, 1, 0, 640, 480, 500.0, 320.0, 240.0))
    if images is not None:
        path = folder / ("images.bin" if isinstance(images, bytes) else "images.txt")
        path.write_bytes(images if isinstance(images, bytes) else images.encode())
    return folder


def read(folder: Path) -> RawCloud:
    [cloud] = Sweeps().read(folder / "points3D.bin")
    return cloud


def test_colmap_folder_yields_points_and_skips_other_files(tmp_path: Path) -> None:
    folder = model(tmp_path / "sparse" / "0", images_bin(poses(np.array([0.0, -1, 0]))))
    skipped: list[Path] = []
    scan_paths = find_scans([str(folder)], False, skipped.append)
    assert [path.name for path in scan_paths] == ["points3D.bin"] and not skipped
    [scan] = read_clouds(scan_paths[0])
    assert np.array_equal(scan.points, POINTS)


def test_colmap_points_of_another_name_are_recognized(tmp_path: Path) -> None:
    (tmp_path / "model.bin").write_bytes(points3d())
    assert np.array_equal(Sweeps().read(tmp_path / "model.bin")[0].points, POINTS)
    assert len(find_scans([str(tmp_path)], False)) == 1


def test_without_cameras_up_is_uncertain_minus_y(tmp_path: Path) -> None:
    cloud = read(model(tmp_path))
    assert (cloud.up, cloud.up_certain, cloud.seen_from) == ("-Y", False, None)


@pytest.mark.parametrize("kind", [images_bin, images_txt])
@pytest.mark.parametrize(("up", "axis"), [((0, -1, 0), "-Y"), ((0, 0, 1), "+Z"), ((0.2, 0.97, 0.1), "+Y")])
def test_cameras_give_up_and_viewpoint(tmp_path: Path, kind, up: tuple[float, ...], axis: str) -> None:
    upward = np.array(up) / np.linalg.norm(up)
    cloud = read(model(tmp_path, kind(poses(upward))))
    assert (cloud.up, cloud.up_certain, cloud.upward) == (axis, True, None)
    assert "9 cameras" in cloud.up_reason
    assert cloud.seen_from is not None and abs(np.linalg.norm(cloud.seen_from) - 17**0.5) < 1e-6  # one of the cameras


def test_cameras_of_a_tilted_model_give_the_up_direction(tmp_path: Path) -> None:
    cloud = read(model(tmp_path, images_bin(poses(TILTED, height=2.0))))
    assert cloud.up == "+Z" and cloud.up_certain
    assert cloud.upward is not None and np.allclose(cloud.upward, TILTED, atol=1e-6)  # though all look down


def test_cameras_in_all_orientations_give_no_up(tmp_path: Path) -> None:
    every = [pose for axis in np.eye(3) for sign in (1, -1) for pose in poses(sign * axis, count=3)]
    cloud = read(model(tmp_path, images_bin(every)))
    assert (cloud.up, cloud.up_certain, cloud.upward) == ("-Y", False, None)


@pytest.mark.parametrize("images", [b"", b"\xff" * 50, images_bin(poses(TILTED))[:-30], "1 2\n", "1 a b c d e f g h"])
def test_damaged_cameras_do_not_affect_the_points(tmp_path: Path, images: str | bytes) -> None:
    assert np.array_equal(read(model(tmp_path, images)).points, POINTS)


@pytest.mark.parametrize("blob", [points3d()[:-1], points3d() + b"\0", points3d()[:500], b"\xff" * 900, b""])
def test_damaged_points_are_refused(tmp_path: Path, blob: bytes) -> None:
    (tmp_path / "points3D.bin").write_bytes(blob)
    if blob:
        with pytest.raises(ScanError, match="COLMAP's"):
            Sweeps().read(tmp_path / "points3D.bin")
    else:
        assert len(Sweeps().read(tmp_path / "points3D.bin")[0].points) == 0


def test_a_colmap_model_in_text_gives_the_same(tmp_path: Path) -> None:
    rows = [f"{index} {x!r} {y!r} {z!r} 10 20 30 0.5 1 2 3 4\n" for index, (x, y, z) in enumerate(POINTS.tolist())]
    (tmp_path / "points3D.txt").write_text("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
                                           + "".join(rows))  # fmt: skip
    (tmp_path / "images.txt").write_text(images_txt(poses(TILTED, height=2.0)))
    (tmp_path / "cameras.txt").write_text("# Camera list\n1 PINHOLE 640 480 500 500 320 240\n")
    [path] = find_scans([str(tmp_path)], False)
    [scan] = read_clouds(path)
    assert np.array_equal(scan.points, POINTS) and (scan.up, scan.up_certain) == ("+Z", True)
    assert scan.upward is not None and np.allclose(scan.upward, TILTED, atol=1e-6) and scan.seen_from is not None
