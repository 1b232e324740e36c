"""Files of passes: the numbers return from each format, by what the camera file says of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from z2p_core.interfaces import SettingError
from z2p_core.pinhole import camera_from_json, pinhole_camera
from z2p_renderer.storage.images.pass_files import check_pass_format, pass_paths, write_passes

CAMERA = pinhole_camera([[50.0, 0, 4], [0, 50, 3], [0, 0, 1]], np.eye(3), [0, 0, 5], (8, 6))


def passes(offset: float = 0.0) -> dict[str, np.ndarray]:
    """A plane whose left column is empty."""
    rng = np.random.default_rng(0)
    images: dict[str, np.ndarray] = {
        "depth": rng.uniform(3, 4, (6, 8)).astype(np.float32),
        "normal": np.broadcast_to(np.float32([0.6, 0, -0.8]), (6, 8, 3)).copy(),
        "albedo": rng.uniform(0, 1, (6, 8, 3)).astype(np.float32),
        "position": rng.uniform(-1, 1, (6, 8, 3)) + offset,
        "alpha": np.ones((6, 8), np.float32),
        "trust": rng.uniform(0, 1, (6, 8)).astype(np.float32),
    }
    for name, image in images.items():
        image[:, 0] = 0 if name in ("alpha", "trust") else np.nan
    return images


def described(folder: Path) -> dict[str, Any]:
    data = json.loads((folder / "fig_camera.json").read_text())
    assert camera_from_json(data) == CAMERA
    entries: dict[str, Any] = data["passes"]
    return entries


def test_arrays_return_as_they_are(tmp_path: Path) -> None:
    images = passes(5e6)
    written = write_passes(images, CAMERA, tmp_path / "fig.png")
    assert written == pass_paths(tmp_path / "fig.png", list(images), "npy") and all(path.is_file() for path in written)
    for name, entry in described(tmp_path).items():
        assert (entry["scale"], entry["offset"]) == (1, 0)
        np.testing.assert_array_equal(np.load(tmp_path / entry["file"]), images[name])


def test_16_bit_pngs_have_a_scale(tmp_path: Path) -> None:
    images = {name: image for name, image in passes().items() if image.ndim == 2}
    write_passes(images, CAMERA, tmp_path / "fig.png", "png")
    for name, entry in described(tmp_path).items():
        with Image.open(tmp_path / entry["file"]) as picture:
            assert picture.mode.startswith("I")
            numbers = np.asarray(picture).astype(float)
        assert (numbers[:, 0] == 0).all() and entry["no_surface"] == "0"
        values = numbers * entry["scale"] + entry["offset"]
        np.testing.assert_allclose(values[:, 1:], images[name][:, 1:], atol=2e-5)


def test_16_bit_pngs_of_three_channels_open(tmp_path: Path) -> None:
    write_passes({"albedo": passes()["albedo"]}, CAMERA, tmp_path / "fig.png", "png")
    entry = described(tmp_path)["albedo"]
    assert entry["encoding"] == "sRGB"
    with Image.open(tmp_path / entry["file"]) as picture:  # pillow reads the upper eight bits
        picture.load()
        assert (picture.mode, picture.size) == ("RGB", (8, 6))


def test_exr_files_hold_floats(tmp_path: Path) -> None:
    openexr = pytest.importorskip("OpenEXR")
    images = passes(5e6)
    write_passes(images, CAMERA, tmp_path / "fig.png", "exr")
    for name, entry in described(tmp_path).items():
        channels = openexr.File(str(tmp_path / entry["file"])).channels()
        numbers = channels["Y" if images[name].ndim == 2 else "RGB"].pixels
        assert numbers.dtype == np.float32
        np.testing.assert_allclose(numbers + np.array(entry["offset"]), images[name], atol=1e-6)


def test_without_openexr_other_formats_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "OpenEXR", None)
    with pytest.raises(SettingError, match=r"\.\[exr\].*npy and png need nothing"):
        check_pass_format("exr")
    with pytest.raises(SettingError, match="npy, png, exr"):
        check_pass_format("tiff")
