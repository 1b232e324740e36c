"""`z2p_core.render` and `Previewer` with tiny weights: what goes in shapes the picture, nothing else moves."""

from __future__ import annotations

import io
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

import z2p_core
from z2p_core.api.render import RenderWarning
from z2p_core.interfaces import ScanError, SettingError
from z2p_renderer.storage.images.image_files import read_record


@pytest.fixture
def small(tiny_weights: Path) -> dict[str, Any]:
    return {"weights": tiny_weights, "size": 48}


def test_a_picture_is_straight_rgba_and_the_same_every_time(cloud: np.ndarray, small: dict[str, Any]) -> None:
    first, second = z2p_core.render(cloud, **small), z2p_core.render(torch.from_numpy(cloud), **small)
    assert (first.array.shape, first.array.dtype) == ((48, 48, 4), np.uint8)
    assert np.array_equal(first.array, second.array)
    assert np.ptp(first.array) > 20
    assert z2p_core.render(cloud, **{**small, "size": (64, 40)}).array.shape == (40, 64, 4)


def test_every_setting_changes_the_picture(cloud: np.ndarray, small: dict[str, Any]) -> None:
    settings: list[dict[str, Any]] = [
        {}, {"color": "red"}, {"color": (0.2, 0.9, 0.1)}, {"light": (3.6, 60, 50)}, {"light": "3.6,80,50"},
        {"elevation": 60}, {"view": (45.0, 20.0)}, {"view": (45.0, 50.0)}, {"view": "front"}, {"azimuth": 70},
        {"up": "+Y"}, {"supersample": 2}, {"background": "white"}, {"smooth": 0.3},
        {"background": np.array([0.5, 0.5, 0.5])}, {"background": "0.9,0.9,1"},
    ]  # fmt: skip
    made = [z2p_core.render(cloud, **small, **more).array.tobytes() for more in settings]
    assert len(set(made)) == len(settings)


@pytest.mark.filterwarnings("ignore:preview")
@pytest.mark.parametrize("size", [np.array([64, 40]), [64.0, 40.0], np.array([64, 40], np.float32)])
def test_a_previewer_takes_what_sizes_render_takes(small: dict[str, Any], size: Any) -> None:
    show = z2p_core.Previewer(weights=small["weights"], size=size)
    assert show(np.full((50, 3), np.nan)).shape == show(np.random.default_rng(0).random((300, 3))).shape == (3, 40, 64)


@pytest.mark.parametrize(
    "wrong",
    [{"color": "nocolour"}, {"color": (2, 0, 0)}, {"color": "red", "light": (1, 2)}, {"elevation": 99}, {"size": 8},
     {"size": (64, 64, 64)}, {"metallic": 0.5}, {"nosuch": 1}, {"view": "side"}, {"view": (1,)}, {"up": "W"},
     {"background": "nocolour"}, {"background": (1, 2, 3)}, {"fit": "loose"}, {"supersample": 7},
     {"azimuth": np.nan}, {"azimuth": np.inf}, {"azimuth": None}, {"view": (np.nan, 10)}, {"view": (0, np.inf)},
     {"view": (0, 60), "elevation": 5},
     {"cut_top": np.nan}, {"cut_top": "5"}, {"smooth": 0.4}, {"smooth": "much"}, {"smooth": np.nan},
     {"camera": {"a": 1}}, {"camera": "nosuch.json"}, {"color": 3j}, {"colors": np.ones(3)},
     {"colors": np.ones((10, 3))}, {"colors": [[1, 0, 0], [1, 0]]}, {"weights": None},
     {"supersample": np.array([1, 2])},
     {"fit": np.array(["frame", "tight"])}, {"up": np.zeros(3)}],
    ids=str,
)  # fmt: skip
def test_wrong_settings_are_value_errors_in_one_line(
    cloud: np.ndarray, small: dict[str, Any], wrong: dict[str, Any]
) -> None:
    with pytest.raises(SettingError) as caught:
        z2p_core.render(cloud, **{**small, **wrong})
    assert isinstance(caught.value, ValueError) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [({"color": "blurple"}, "color: expected a CSS colour"), ({"light": (9, 0, 40)}, "light: radius is 9"),
     ({"sise": 5}, r"unknown argument 'sise' \(did you mean size\?\)"),
     ({"bg": "white"}, r"'bg' \(did you mean background\?\)"), ({"noise": 1}, "'noise'; expected"),
     ({"sparkle": 1}, "'sparkle'; expected points, "), ({"metallic": 1}, "do not carry the control 'metallic'")],
    ids=str,
)  # fmt: skip
def test_what_is_wrong_is_told_in_pythons_words(
    cloud: np.ndarray, small: dict[str, Any], wrong: dict[str, Any], told: str
) -> None:
    with pytest.raises(SettingError, match=told) as caught:
        z2p_core.render(cloud, **small, **wrong)
    assert "--" not in str(caught.value)


def test_a_batch_is_a_sheet_and_a_sequence(cloud: np.ndarray, small: dict[str, Any]) -> None:
    batch = z2p_core.render(np.stack([cloud, cloud[:, ::-1], cloud * 2]), **small)
    assert len(batch) == 3 and batch.array.shape == (96, 96, 4)
    alone = z2p_core.render(cloud, **small)
    assert np.array_equal(batch[0].array, alone.array) and np.array_equal(batch.array[:48, :48], alone.array)
    assert not batch.array[48:, 48:].any()  # the cell that is left over
    assert [one.array.shape for one in batch] == [(48, 48, 4)] * 3
    assert len(alone) == 1 and alone[0] is alone
    white = batch.on("white")
    assert (white.array[..., 3] == 255).all() and len(white) == 3 and (white[1].array[..., 3] == 255).all()
    for bad, told in ((cloud * np.nan, r"cloud \[1\]: none of"), (cloud + 1e6, r"cloud \[1\]: lies beyond")):
        with pytest.raises(ScanError, match=told):
            z2p_core.render([cloud, bad], **small, camera=alone.camera)
    with pytest.raises(ScanError, match="empty batch"):
        z2p_core.render(np.empty((0, 5, 3)), **small)


def test_one_camera_keeps_size_and_place(cloud: np.ndarray, small: dict[str, Any]) -> None:
    picture = z2p_core.render(cloud, **small, azimuth=25)
    again = z2p_core.render(cloud, **small, camera=picture.camera)
    assert np.array_equal(again.array, picture.array)
    assert again.camera == picture.camera
    assert np.array_equal(z2p_core.render(cloud, **small, camera=picture).array, picture.array)
    whole = z2p_core.render(cloud, **small, camera=picture.camera, view=(70.0, 60.0), up="-Y")  # not half of it
    assert np.array_equal(whole.array, picture.array)
    half = z2p_core.render((cloud - cloud.mean(0)) / 2 + cloud.mean(0), **small, camera=picture.camera.to_json())
    assert not np.array_equal(half.array, picture.array)
    assert np.array_equal(z2p_core.render(cloud / 2, **small, azimuth=25).array, picture.array)  # without it: no scale
    with pytest.raises(ScanError, match="beyond the camera's frame"):
        z2p_core.render(cloud + 1000, **small, camera=picture.camera)
    with pytest.warns(RenderWarning, match="100 points lie beyond"):
        z2p_core.render(np.vstack([cloud, cloud[:100] + 9]), **small, camera=picture.camera)


def test_what_is_left_out_is_said(cloud: np.ndarray, small: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        z2p_core.render(cloud, **small)
    with pytest.warns(RenderWarning, match="has the colour given"):
        green = z2p_core.render(cloud, np.ones(cloud.shape), color="lime", **small)
    assert green.record["controls"]["color"] == [0, 1, 0]
    with pytest.warns(RenderWarning, match=r"columns behind x, y, z were left out \(3\)"):
        z2p_core.render(np.hstack([cloud, cloud]), **small)
    broken = cloud.copy()
    broken[:7] = np.nan
    with pytest.warns(RenderWarning, match="7 points that are not finite"):
        z2p_core.render(broken, **small)
    with pytest.warns(RenderWarning, match=r"rounded to steps of 0\.5: save float64"):
        z2p_core.render((cloud + np.array([691234, 5334567, 512])).astype(np.float32), **small)
    with pytest.warns(RenderWarning, match="so few points tell no surface"):
        z2p_core.render(cloud[:50], **small)
    floors = [np.column_stack([cloud[:, :2] * 4, np.full(len(cloud), height)]) for height in (0.0, 2.4)]
    with pytest.warns(RenderWarning, match="room: cut_top=40 elevation=55 shows its inside"):
        z2p_core.render(np.vstack(floors), **small)
    with pytest.warns(RenderWarning, match="1 stray point left"):
        z2p_core.render(np.vstack([cloud, [[90.0, 0, 0]]]), **small)


def test_files_go_in_by_their_path(scans: Path, small: dict[str, Any], cloud: np.ndarray) -> None:
    picture = z2p_core.render(scans / "one.npy", up="Z", **small)
    assert np.array_equal(picture.array, z2p_core.render(cloud, **small).array)
    assert picture.record["input"]["name"] == "one.npy"
    with pytest.raises(ScanError, match="nosuch"):
        z2p_core.render("nosuch.ply", **small)


def test_up_is_the_files_convention_unless_told(tmp_path: Path, small: dict[str, Any], cloud: np.ndarray) -> None:
    """As on the command line; an array has no convention of its own."""
    file = tmp_path / "one.obj"
    file.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in cloud.astype(float)))
    picture = z2p_core.render(file, **small)
    assert np.array_equal(picture.array, z2p_core.render(cloud, up="+Y", **small).array)
    assert np.array_equal(z2p_core.render(file, up="+Z", **small).array, z2p_core.render(cloud, **small).array)


@pytest.mark.parametrize("suffix", [".png", ".webp", ".tiff", ".jpg"])
def test_saved_pictures_carry_their_record(
    cloud: np.ndarray, small: dict[str, Any], tmp_path: Path, suffix: str
) -> None:
    picture = z2p_core.render(cloud, **small, color="teal")
    path = picture.save(tmp_path / f"sub/a{suffix}")
    read = np.asarray(Image.open(path))
    if suffix == ".jpg":
        assert np.abs(read.astype(int) - picture.on("white").array[..., :3]).mean() < 4
    else:
        assert np.array_equal(read, picture.array)
    behind = {"background": [1.0, 1.0, 1.0]} if suffix == ".jpg" else {}
    assert read_record(path) == {**picture.record, **behind}
    with pytest.raises(ValueError, match=r"\.png"):
        picture.save(tmp_path / "a.bmp")
    with pytest.raises(SettingError, match=r"expected a path .*, got BytesIO"):
        picture.save(io.BytesIO())  # type: ignore[arg-type]


def test_it_shows_itself_in_a_notebook(cloud: np.ndarray, small: dict[str, Any], tmp_path: Path) -> None:
    picture = z2p_core.render(cloud, **small)
    (tmp_path / "cell.png").write_bytes(picture._repr_png_())
    assert np.array_equal(np.asarray(Image.open(tmp_path / "cell.png")), picture.array)
    assert np.asarray(picture) is picture.array
    assert repr(picture) == "<Picture 48x48 of an array>"
    assert repr(z2p_core.render([cloud, cloud], **small)) == "<Picture 96x48 of 2 clouds>"


def test_torch_around_it_notices_nothing(cloud: np.ndarray, tiny_weights: Path, tmp_path: Path) -> None:
    copy = tmp_path / "fresh.safetensors"  # weights not yet loaded
    copy.write_bytes(tiny_weights.read_bytes())
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    torch.set_default_device("meta")
    try:
        z2p_core.render(cloud, weights=copy, size=48)
    finally:
        torch.set_default_device("cpu")
    assert torch.equal(torch.rand(3), expected)
    assert torch.is_grad_enabled()


def test_a_previewer_always_gives_a_picture(cloud: np.ndarray, small: dict[str, Any]) -> None:
    preview = z2p_core.Previewer(**small, most=4)
    image = preview(torch.from_numpy(cloud).requires_grad_())
    assert (image.shape, image.dtype) == ((3, 48, 48), np.uint8) and preview.error is None
    assert preview(np.stack([cloud] * 9)).shape == (3, 96, 96)
    for bad in (np.full((50, 3), np.nan), np.zeros((50, 3)), np.zeros((0, 3)), np.zeros((5, 7, 7, 3)), "text", None):
        with pytest.warns(RenderWarning, match="preview: "):
            image = preview(bad)
        assert image.shape == (3, 48, 48) and preview.error
    mixed = np.stack([cloud, np.full_like(cloud, np.nan)])
    with pytest.warns(RenderWarning, match="preview: "):
        image = preview(mixed)
    assert image.shape == (3, 48, 96)
    assert np.array_equal(image[:, :, :48], preview(cloud))


def test_a_previewers_view_stays_and_wrong_options_show_at_once(cloud: np.ndarray, small: dict[str, Any]) -> None:
    preview = z2p_core.Previewer(**small)
    fixed = z2p_core.render(cloud, **small, view=(30.0, 20.0), background="white")
    assert np.array_equal(preview(cloud), fixed.array[..., :3].transpose(2, 0, 1))
    with pytest.raises(SettingError, match="nocolour"):
        z2p_core.Previewer(**small, color="nocolour")


def test_importing_the_core_imports_nothing_heavy() -> None:
    code = "import sys, z2p_core; assert not {'torch', 'numpy', 'PIL'} & set(sys.modules), 1; z2p_core.render"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


@pytest.mark.parametrize("radius", [np.nan, 0.0, -1.0, 1e-320, np.inf])
def test_a_camera_made_by_hand_is_checked(cloud: np.ndarray, small: dict[str, Any], radius: float) -> None:
    camera = z2p_core.render(cloud, **small).camera
    with pytest.raises(SettingError, match="radius"):
        z2p_core.render(cloud, camera=replace(camera, radius=radius), **small)


def test_masked_points_count_as_missing(cloud: np.ndarray, small: dict[str, Any]) -> None:
    masked = np.ma.masked_array(cloud, mask=np.arange(cloud.size).reshape(cloud.shape) % 30 == 0)
    with pytest.warns(RenderWarning, match="not finite were dropped"):
        picture = z2p_core.render(masked, **small)
    kept = z2p_core.render(cloud[~masked.mask.any(axis=1)], **small)
    assert np.array_equal(picture.array, kept.array)


def test_clouds_of_laspy_are_points(cloud: np.ndarray, small: dict[str, Any]) -> None:
    laspy = pytest.importorskip("laspy")
    las = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    las.header.scales = [1e-6] * 3
    las.x, las.y, las.z = cloud.T
    assert z2p_core.render(las, **small).array.any()


def test_a_preview_takes_sizes_lists_and_strict_warnings(cloud: np.ndarray, tiny_weights: Path) -> None:
    preview = z2p_core.Previewer(size=(48, 40), weights=tiny_weights)
    assert preview(cloud).shape == (3, 40, 48)
    assert np.array_equal(preview(cloud.tolist()), preview(cloud)) and preview.error is None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert preview(cloud * np.nan).shape == (3, 40, 48)
    assert preview.error is not None


def test_drawing_leaves_torchs_generator_to_others(cloud: np.ndarray, small: dict[str, Any]) -> None:
    z2p_core.render(cloud, **small)
    drawn = []

    def draw() -> None:
        z2p_core.render(cloud, **small)

    torch.manual_seed(1)
    wanted = torch.rand(400).tolist()
    torch.manual_seed(1)
    thread = Thread(target=draw)
    thread.start()
    while len(drawn) < 400:
        drawn.append(float(torch.rand(1)))
        if len(drawn) == 200:
            thread.join()
    assert drawn == wanted  # none came twice, whatever the other thread did in between
