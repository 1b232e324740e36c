"""Files of cameras: COLMAP's and nerfstudio's conventions against poses computed by hand, and z2p's own JSON."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from z2p_core.interfaces import SettingError
from z2p_core.pinhole import pinhole_camera
from z2p_renderer.storage.cameras import read_any_camera, read_pinholes
from z2p_renderer.storage.poses.read_poses import read_poses, write_poses

HALF = np.sqrt(0.5)
QUARTER_TURN = (HALF, HALF, 0.0, 0.0)
"""By 90 degrees about +X: (x, y, z) -> (x, -z, y)."""


def colmap_text(folder: Path, model: str = "PINHOLE 640 480 500 510 320.5 239.5") -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "cameras.txt").write_text(f"# Camera list\n1 {model}\n")
    w, x, y, z = QUARTER_TURN
    (folder / "images.txt").write_text(
        "# Image list\n"
        f"2 {w} {x} {y} {z} 1 2 3 1 b/two words.jpg\n10 20 -1 30 40 5\n"
        "1 1 0 0 0 0 0 4 1 a.jpg\n\n"
    )  # fmt: skip
    return folder


def colmap_binary(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    camera = struct.pack("<Q", 1) + struct.pack("<iiQQ4d", 1, 1, 640, 480, 500, 510, 320.5, 239.5)
    (folder / "cameras.bin").write_bytes(camera)
    images = struct.pack("<Q", 2)
    images += struct.pack("<i7di", 2, *QUARTER_TURN, 1, 2, 3, 1) + b"b/two words.jpg\0" + struct.pack("<Q", 1)
    images += struct.pack("<ddq", 10, 20, -1)
    images += struct.pack("<i7di", 1, 1, 0, 0, 0, 0, 0, 4, 1) + b"a.jpg\0" + struct.pack("<Q", 0)
    (folder / "images.bin").write_bytes(images)
    return folder


@pytest.mark.parametrize("write", [colmap_text, colmap_binary])
def test_colmap_models_are_read(tmp_path: Path, write: Any) -> None:
    cameras, note = read_poses(write(tmp_path / "sparse"))
    assert [camera.name for camera in cameras] == ["a.jpg", "b/two words.jpg"] and not note
    front, turned = cameras
    assert (front.width, front.height, front.focal, front.center) == (640, 480, (500, 510), (320.5, 239.5))
    np.testing.assert_allclose(front.project(np.array([[0.0, 0, 0]]))[0], [[320.5, 239.5]])
    # by hand: R (0, 2, 0) + t = (0, 0, 2) + (1, 2, 3)
    pixels, depth = turned.project(np.array([[0.0, 2, 0]]))
    np.testing.assert_allclose(depth, [5])
    np.testing.assert_allclose(pixels, [[320.5 + 500 / 5, 239.5 + 510 * 2 / 5]])


def test_the_folder_of_a_reconstruction_stands_for_its_first_model(tmp_path: Path) -> None:
    (tmp_path / "sparse").mkdir()
    colmap_binary(tmp_path / "sparse" / "0")
    assert len(read_poses(tmp_path)[0]) == len(read_poses(tmp_path / "sparse")[0]) == 2


def test_a_file_of_a_model_stands_for_it(tmp_path: Path) -> None:
    folder = colmap_text(tmp_path / "sparse")
    assert len(read_poses(folder / "images.txt")[0]) == len(read_poses(folder / "cameras.txt")[0]) == 2
    assert read_poses(colmap_text(folder, "SIMPLE_RADIAL 640 480 500 320 240 0.1"))[1].startswith("lens distortion")


@pytest.mark.parametrize(
    ("model", "word"),
    [("OPENCV_FISHEYE 6 4 5 5 3 2 0 0 0 0", "undistort"), ("PINHOLE 6 4 5", "4 parameters"), ("MINE 6 4 5", "'MINE'")],
)
def test_colmap_cameras_that_are_no_pinholes_are_refused(tmp_path: Path, model: str, word: str) -> None:
    with pytest.raises(SettingError, match=word):
        read_poses(colmap_text(tmp_path / "sparse", model))


def test_damaged_models_are_refused(tmp_path: Path) -> None:
    folder = colmap_binary(tmp_path / "sparse")
    (folder / "images.bin").write_bytes((folder / "images.bin").read_bytes()[:90])
    with pytest.raises(SettingError, match="damaged"):
        read_poses(folder)
    (folder / "images.bin").unlink()
    with pytest.raises(SettingError, match="side by side"):
        read_poses(folder)


def transforms(**changes: Any) -> dict[str, Any]:
    """A camera at (0, -5, 0) that looks along +Y with +Z up: OpenGL's axes are right, up and back."""
    pose = [[1, 0, 0, 0], [0, 0, -1, -5], [0, 1, 0, 0], [0, 0, 0, 1]]
    frame = {"file_path": "images/frame_00001.png", "transform_matrix": pose}
    return {"w": 400, "h": 300, "fl_x": 200.0, "fl_y": 210.0, "cx": 190.0, "cy": 160.0, "frames": [frame], **changes}


def test_nerfstudio_poses_are_opengls(tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps(transforms()))
    [camera], note = read_poses(path)
    assert camera.name == "images/frame_00001.png" and not note
    pixels, depth = camera.project(np.array([[1.0, 5, 2]]))  # to the right, above, 10 before the camera
    np.testing.assert_allclose(depth, [10])
    np.testing.assert_allclose(pixels, [[190 + 20, 160 - 42]])
    np.testing.assert_allclose(camera.position, [0, -5, 0], atol=1e-12)
    assert read_poses(tmp_path)[0] == [camera]  # the folder stands for the file


def test_an_angle_stands_for_the_focal_length(tmp_path: Path) -> None:
    path = tmp_path / "transforms_train.json"
    data = transforms(camera_angle_x=2 * np.arctan(0.5), k1=0.1)
    for key in ("fl_x", "fl_y", "cx", "cy"):
        del data[key]
    path.write_text(json.dumps(data))
    [camera], note = read_poses(path)
    np.testing.assert_allclose(camera.focal, [400, 400])
    assert camera.center == (200, 150) and "distortion" in note


@pytest.mark.parametrize(
    ("changes", "word"),
    [({"camera_model": "OPENCV_FISHEYE"}, "undistort"), ({"w": 0}, "w and h"), ({"frames": [{}]}, "transform_matrix"),
     ({"frames": []}, "empty list"), ({"frames": [4]}, "frame 0")],
)  # fmt: skip
def test_transforms_without_cameras_are_refused(tmp_path: Path, changes: dict[str, Any], word: str) -> None:
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps(transforms(**changes)))
    with pytest.raises(SettingError, match=word):
        read_poses(path)


def test_cameras_of_z2p_return(tmp_path: Path) -> None:
    one = pinhole_camera([[9, 0, 3], [0, 9, 2], [0, 0, 1]], np.eye(3), [0, 0, 4], (64, 32), name="one")
    write_poses([one], tmp_path / "one.json")
    write_poses([one, one], tmp_path / "two.json")
    assert read_any_camera(tmp_path / "one.json") == one
    found = read_pinholes(tmp_path / "two.json")
    assert found is not None and found[0] == [one, one]
    with pytest.raises(SettingError, match="expected one camera, got 2"):
        read_any_camera(tmp_path / "two.json")


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text('[{"a": 1}]')
    with pytest.raises(SettingError, match="camera 0: expected an object with K, R, t"):
        read_poses(tmp_path / "other.json")
    with pytest.raises(SettingError, match="No such file"):
        read_poses(tmp_path / "none.json")
    with pytest.raises(SettingError, match="not JSON"):
        (tmp_path / "no.json").write_text("{")
        read_poses(tmp_path / "no.json")
