"""Records inside pictures and camera files, sound and edited: each is taken, or refused by the documented error."""

from __future__ import annotations

import io
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from changed_bytes import changed as changed_bytes
from changed_values import changed, json_text, plain
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from z2p_core.interfaces import SettingError
from z2p_core.placement.viewpoint import Viewpoint, viewpoint_from_json
from z2p_renderer.pipeline.outputs.gallery import write_gallery
from z2p_renderer.storage.cameras import read_camera, write_camera
from z2p_renderer.storage.images.image_files import DESCRIPTION_TAG, RECORD_KEYWORD, PictureError, read_record
from z2p_renderer.storage.images.png import encode_png

SUFFIXES = (".png", ".png", ".png", ".webp", ".jpg", ".tif", ".gif")
SOUND = "a-sound-one.png"


def make(rng: np.random.Generator, folder: Path) -> None:
    """Either a camera file, or a picture with a record beside one that is sound."""
    if rng.random() < 0.4:
        text = json_text(changed(_record()["camera"], rng)).encode(errors="surrogatepass")
        (folder / "camera.json").write_bytes(changed_bytes(text, rng) if rng.random() < 0.2 else text)
        return
    record = changed(_record(), rng) if rng.random() < 0.95 else _record()
    text = json_text(record)
    if rng.random() < 0.15:
        text = changed_bytes(text.encode(), rng).decode("latin-1")
    suffix = str(rng.choice(SUFFIXES))
    blob = picture_file(suffix, text)
    (folder / SOUND).write_bytes(picture_file(".png", json.dumps(_record())))
    (folder / f"picture{suffix}").write_bytes(changed_bytes(blob, rng) if rng.random() < 0.15 else blob)


def check(folder: Path) -> str:
    """What came of it."""
    camera = folder / "camera.json"
    if camera.exists():
        return f"camera {_camera(camera)}"
    (picture,) = (path for path in folder.iterdir() if path.name.startswith("picture."))
    try:
        record = read_record(picture)
        assert isinstance(record, dict)
        json.dumps(record, allow_nan=False)
        label = "record read"
    except PictureError as error:
        _one_line(error)
        label = "record refused"
    _camera(picture)
    page = write_gallery([folder / SOUND, picture], folder / "index.html").read_text()
    assert all(path.stem in page for path in (folder / SOUND, picture)), "a picture that the gallery leaves out"
    return label


def picture_file(suffix: str, text: str) -> bytes:
    """A small picture in the format of the suffix, with a text where the record belongs."""
    pixels = np.full((8, 8, 4), 200, np.uint8)
    image, file = Image.fromarray(pixels), io.BytesIO()
    if suffix == ".png":
        if text.isascii():
            return encode_png(pixels, {RECORD_KEYWORD: text})
        told = PngInfo()
        told.add_itxt(RECORD_KEYWORD, text)
        image.save(file, "PNG", pnginfo=told)
        return file.getvalue()
    described = f"{RECORD_KEYWORD}: {text}".encode("ascii", errors="replace").decode()[:60_000]
    exif = Image.Exif()
    exif[DESCRIPTION_TAG] = described
    match suffix:
        case ".webp":
            image.save(file, "WEBP", exif=exif)
        case ".jpg":
            image.convert("RGB").save(file, "JPEG", exif=exif)
        case ".tif":
            image.save(file, "TIFF", description=described)
        case _:
            image.convert("P").save(file, "GIF", comment=described.encode())
    return file.getvalue()


def _camera(path: Path) -> str:
    try:
        viewpoint = read_camera(path)
    except SettingError as error:
        _one_line(error)
        return "refused"
    _check(viewpoint)
    write_camera(viewpoint, path.with_name("again.json"))
    assert read_camera(path.with_name("again.json")) == viewpoint
    return "read"


def _check(viewpoint: Viewpoint) -> None:
    """A viewpoint that is taken can be looked from."""
    near = np.array([viewpoint.centre]) + viewpoint.radius * np.eye(3)
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        assert np.isfinite(viewpoint.place(near)).all(), f"points before it are no places: {viewpoint}"
    assert np.isfinite(viewpoint.elevation) and abs(viewpoint.elevation) <= 360, viewpoint
    assert viewpoint.floor is None or np.isfinite(viewpoint.floor)
    given: Any = plain(viewpoint.to_json())
    assert viewpoint_from_json(given) == viewpoint


@lru_cache(maxsize=1)
def _record() -> dict[str, Any]:
    """That of a real picture, as its file has it."""
    import z2p_core

    picture = z2p_core.render(np.random.default_rng(0).normal(size=(200, 3)), size=32)
    record: dict[str, Any] = json.loads(json.dumps(picture.record))
    record["input"]["path"] = "scan.ply"
    return record


def _one_line(error: Exception) -> None:
    text = str(error)
    assert "\n" not in text and len(text) < 1500, f"a message that is no line: {text[:300]!r} ({len(text)})"
