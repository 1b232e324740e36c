"""Pictures keep their pixels and their record in every format; files without a record are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from z2p_core.camera import turn
from z2p_core.interfaces import SettingError
from z2p_core.placement.viewpoint import frame_points
from z2p_renderer.storage.cameras import read_camera, write_camera
from z2p_renderer.storage.images.image_files import FORMATS, PictureError, encode_picture, read_record, write_picture

PICTURE = np.random.default_rng(0).integers(0, 256, size=(40, 50, 4)).astype(np.uint8)
RECORD = {"record": 1, "input": {"name": 'Bär "<x>".ply'}, "deep": [[1.5, None]]}


@pytest.mark.parametrize("suffix", FORMATS)
def test_pixels_and_record_survive(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    write_picture(PICTURE, path, record=RECORD)
    assert read_record(path) == RECORD
    picture = Image.open(path)
    if suffix in (".jpg", ".jpeg"):
        assert picture.mode == "RGB"
    else:
        assert np.array_equal(np.asarray(picture), PICTURE)
    assert encode_picture(PICTURE, suffix, record=RECORD) == path.read_bytes()  # no clock, no chance in it


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_background_makes_pictures_opaque(suffix: str, tmp_path: Path) -> None:
    write_picture(np.zeros((40, 40, 4), np.uint8), tmp_path / f"a{suffix}", (1.0, 0.5, 0.0))
    picture = Image.open(tmp_path / f"a{suffix}")
    assert picture.mode == "RGB"
    assert np.abs(np.asarray(picture).astype(int) - (255, 128, 0)).max() <= 2


def test_files_without_a_record_are_refused(tmp_path: Path) -> None:
    write_picture(PICTURE, tmp_path / "a.png")
    with pytest.raises(PictureError, match=r"a\.png: holds no record"):
        read_record(tmp_path / "a.png")
    Image.fromarray(PICTURE).save(tmp_path / "b.png", pnginfo=None)
    for name, content in {"c.png": b"garbage", "d.png": encode_picture(PICTURE, ".png", record=RECORD)[:60]}.items():
        (tmp_path / name).write_bytes(content)
    for name in ("b.png", "c.png", "d.png", "missing.png"):
        with pytest.raises(PictureError, match=name) as caught:
            read_record(tmp_path / name)
        assert "\n" not in str(caught.value)
    with pytest.raises(PictureError, match="expected a picture named"):
        encode_picture(PICTURE, ".bmp")


def test_a_camera_comes_from_json_or_from_a_picture(tmp_path: Path) -> None:
    viewpoint = frame_points(np.random.default_rng(1).normal(size=(50, 3)) + 5e6, turn(20.0), 31.0)
    write_camera(viewpoint, tmp_path / "cam.json")
    write_picture(PICTURE, tmp_path / "fig.png", record={"record": 1, "camera": viewpoint.to_json()})
    assert read_camera(tmp_path / "cam.json") == read_camera(tmp_path / "fig.png") == viewpoint
    (tmp_path / "bad.json").write_bytes(b"\xff{")
    (tmp_path / "list.json").write_text("[]")
    write_picture(PICTURE, tmp_path / "plain.png")
    write_picture(PICTURE, tmp_path / "other.png", record={"record": 1})
    for name in ("bad.json", "list.json", "plain.png", "other.png", "missing.json", "missing.png"):
        with pytest.raises(SettingError, match=name):
            read_camera(tmp_path / name)
