"""Records inside pictures: those that z2p writes are valid; edited ones are refused with the invalid key."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

import z2p_core
from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.outputs.gallery import write_gallery
from z2p_renderer.storage.cameras import read_camera
from z2p_renderer.storage.images.image_files import PictureError, read_record
from z2p_renderer.storage.images.record_schema import record_fault


@pytest.fixture(scope="module")
def record(tmp_path_factory, make_weights) -> dict:
    points = np.random.default_rng(0).normal(size=(500, 3))
    picture = z2p_core.render(points, size=32, weights=make_weights())
    return read_record(picture.save(tmp_path_factory.mktemp("pictures") / "a.png"), complete=True)


def changed(record: object, path: str, value: object) -> dict:
    head, _, rest = path.partition(".")
    return {**record, head: changed(record.get(head, {}), rest, value) if rest else value}  # type: ignore[attr-defined]


def picture(path: Path, text: str) -> Path:
    info = PngInfo()
    info.add_itxt("z2p", text)
    Image.new("RGBA", (8, 8), "teal").save(path, pnginfo=info)
    return path


ODD = {
    "record": ["1", True, 2, None], "controls": [[], {"color": "red"}, {"color": [None, 1, 2]}, {"color": []}],
    "controls.color": [[1e9, 0, 0]], "input": ["scan.ply"], "input.name": [3], "input.cloud": [-1, "0"],
    "weights": [None], "weights.name": [{}], "resolution": [[0, 32], [32], "32x32", [1e6, 1e6], [10**30, 1]],
    "background": ["opaque", [2, 0, 0], [1, 2]], "supersample": [0, 10**6, 1.5], "fit": ["loose"],
    "placing": [[]], "placing.view": [{}], "stance.azimuth": ["north"], "stance.outliers": [-1, 1.5],
    "camera": ["front", {}], "camera.radius": [0, -1, "1"], "camera.rotation": [[[1, 0], [0, 1]], "none"],
    "camera.centre": [[1, 2], ["1", "2", "3"]], "window": [[1, 2]], "motion": [3], "batch": [0], "version": [1],
}  # fmt: skip


@pytest.mark.parametrize("path", ODD)
def test_an_impossible_value_is_refused_by_its_key(record, path, tmp_path):
    assert record_fault(record, complete=True) == ""
    for value in ODD[path]:
        fault = record_fault(changed(record, path, value))
        assert path.split(".")[0] in fault, (path, value)
        file = picture(tmp_path / "odd.png", json.dumps(changed(record, path, value)))
        with pytest.raises(PictureError, match=r"odd\.png: its record cannot be used: "):
            read_record(file)
        with pytest.raises(SettingError):
            read_camera(file)
        write_gallery([file], tmp_path / "index.html")


TEXTS = ["{", "3", "[]", "null", '{"record": NaN}', '{"record": 1, "x": 1e999}', '{"record": 1' + "0" * 5000 + "}",
         '{"record": 1, "x": ' + "[" * 5000 + "]" * 5000 + "}", "[" * 100_000]  # fmt: skip


@pytest.mark.parametrize("text", TEXTS, ids=range(len(TEXTS)))
def test_a_text_that_is_no_record_is_refused(text, tmp_path):
    with pytest.raises(PictureError):
        read_record(picture(tmp_path / "odd.png", text))
    (tmp_path / "camera.json").write_text(text)
    with pytest.raises(SettingError, match=r"camera\.json"):
        read_camera(tmp_path / "camera.json")


@pytest.mark.parametrize("part", ["input", "stance", "weights", "camera", "controls", "resolution"])
def test_a_complete_record_needs_all_its_parts(record, part, tmp_path):
    less = {key: value for key, value in record.items() if key != part}
    file = picture(tmp_path / "less.png", json.dumps(less))
    assert read_record(file) == less
    with pytest.raises(PictureError, match=f"{part}: expected .*, got none"):
        read_record(file, complete=True)


def test_damaged_pictures_do_not_stop_a_gallery(record, tmp_path):
    files = [tmp_path / f"{name}.png" for name in ("cut", "empty", "text", "gone", "folder", "bomb")]
    sound = picture(tmp_path / "sound.png", json.dumps(record))
    files[0].write_bytes(sound.read_bytes()[:60])
    files[1].touch()
    files[2].write_text("no picture")
    files[4].mkdir()
    files[5].write_bytes(sound.read_bytes()[:16] + b"\x7f\xff\xff\xff" * 2 + sound.read_bytes()[24:])
    page = write_gallery([*files, sound], tmp_path / "index.html").read_text()
    assert page.count("<figure") == 7 and page.count('class="missing"') == 6 and page.count("<img ") == 1
    assert all(f">{file.stem}</a>" in page for file in [*files, sound])


def test_a_lone_surrogate_does_not_stop_a_gallery(record, tmp_path):
    file = picture(tmp_path / "odd.png", json.dumps(changed(record, "stance.view_reason", "of \udc00")))
    assert "of &#56320;" in write_gallery([file], tmp_path / "index.html").read_text()
