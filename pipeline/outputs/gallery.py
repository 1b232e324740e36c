"""The gallery: one self-contained HTML page with all pictures of a folder and the settings of each."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from PIL import Image

from z2p_core import __version__
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.images.image_files import PictureError, read_record
from z2p_renderer.storage.scans.silenced_libraries import quiet

THUMBNAIL_SIDES = ((200, 512), (1000, 320), (4000, 224))
"""(Largest number of pictures, side in pixels): pages of thousands must still open in a browser."""
MIN_THUMBNAIL_SIDE = 160
"""Side if there are more pictures than `THUMBNAIL_SIDES` has, pixels."""
GENERATOR_TAG = b'name="generator" content="z2p'
"""Part of the HTML head by which a page of z2p is known."""
HEAD_BYTES = 2000
"""Bytes of a file in which `GENERATOR_TAG` is looked for."""


def write_gallery(pictures: Sequence[Path], path: Path, title: str = "") -> Path:
    """Writes the page to `path`, and returns it.

    The page contains reduced pictures; each name links to the picture's file.

    Raises:
        PictureError: a file of another kind is there; see `check_gallery_place`.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    check_gallery_place(path)
    environment = Environment(loader=PackageLoader("z2p_renderer.pipeline"), autoescape=True, undefined=StrictUndefined)
    side = next((side for max_pictures, side in THUMBNAIL_SIDES if len(pictures) <= max_pictures), MIN_THUMBNAIL_SIDE)
    cards = [_build_card(picture, path.parent, side) for picture in pictures]
    page = environment.get_template("gallery.html").render(
        title=title or f"{_printable_name(path.absolute().parent.name)} - z2p", cards=cards, version=__version__
    )
    atomic_write(page.encode(errors="xmlcharrefreplace"), path)  # records may hold lone surrogates
    return path


def check_gallery_place(path: Path) -> None:
    """Makes sure that a gallery would replace nothing but a gallery.

    Raises:
        PictureError: a file of another kind is there.
    """
    if path.exists() and GENERATOR_TAG not in path.read_bytes()[:HEAD_BYTES]:
        raise PictureError(f"{printable(path)} is there already, and is no gallery of z2p: rename it, or choose "
                           "another folder")


def _build_card(picture: Path, folder: Path, side: int) -> dict[str, Any]:
    """The template's values for one picture; one that cannot be read gets a row that says so."""
    try:
        record = read_record(picture)
    except PictureError:  # another program's picture is shown without settings
        record = {}
    relative = os.path.relpath(picture, folder)
    settings, image = _settings_rows(record), _data_uri(picture, side)
    if not image:
        settings = [("file", "cannot be read as a picture"), *settings]
    color = record.get("controls", {}).get("color", ())
    has_swatch = len(color) == 3 and all(0 <= channel <= 1 for channel in color)
    text = " ".join([_printable_name(relative), *(f"{key} {value}" for key, value in settings)]).lower()
    return {
        "name": _printable_name(Path(relative).with_suffix("").as_posix()),
        "href": quote(Path(relative).as_posix().encode(errors="surrogateescape")),
        "image": image,
        "settings": settings,
        "swatch": "#" + "".join(f"{round(255 * channel):02x}" for channel in color) if has_swatch else "",
        "text": text,
    }


def _settings_rows(record: dict[str, Any]) -> list[tuple[str, str]]:
    """The rows (name, text) of the table of settings."""
    if not record:
        return []
    stance, controls = record.get("stance", {}), record.get("controls", {})
    rows = [("scan", _printable_name(str(record.get("input", {}).get("name") or "an array")))]
    rows += [(name, ", ".join(f"{number:g}" for number in (round(x, 3) for x in value)))
             for name, value in controls.items()]  # fmt: skip
    rows += [("up", _printable_name(f"{stance.get('up', '')}: {stance.get('up_reason', '')}")),
             ("view", f"azimuth {stance.get('azimuth') or 0:.0f}, {stance.get('view_reason', '')}")]  # fmt: skip
    if stance.get("outliers"):
        rows.append(("left out", f"outliers: {stance['outliers']}"))
    rows += color_rows(record)
    rows += placement_rows(record)
    weights = record.get("weights", {})
    rows.append(("weights", f"{weights.get('name', '')} {str(weights.get('sha256', ''))[:12]}"))
    rows.append(("made by", f"z2p {record.get('version', '')}"))
    return rows


def color_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Rows (name, text) for the style and what colors the points; none of a surface in one color."""
    rows = []
    if "style" in record:
        radius = "" if record.get("radius") is None else f", radius {record['radius']}"
        rows.append(("style", f"{record['style']}{radius}"))
    by = record.get("color_by", "none")
    if by != "none":
        limits = record.get("clim")
        scale = f", {record['colormap']} from {limits[0]:.6g} to {limits[1]:.6g}" if limits else ""
        light = "" if record.get("relight", 1) == 1 else f", {100 * record['relight']:g} % of the light"
        rows.append(("coloured by", f"{by}{scale}{light}"))
    if record.get("classes"):
        rows.append(("classes", ", ".join(map(str, record["classes"]))))
    return rows


def placement_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Rows (name, text) for the settings of the placement that are not the defaults."""
    placing = record.get("placing", {})
    rows = []
    if placing.get("cut_top"):
        rows.append(("cut off", f"{placing['cut_top']:g} % of the height, from above"))
    if placing.get("keep_outliers"):
        rows.append(("kept", "outliers and background"))
    if isinstance(record.get("margin"), int | float):
        rows.append(("margin", f"{100 * record['margin']:g} % of the shorter side"))
    return rows


def _data_uri(picture: Path, side: int) -> str:
    """A data URI of the reduced picture, as WebP; empty if the file cannot be read as a picture."""
    try:
        if not picture.is_file():  # reading a pipe would wait
            return ""
        with quiet(), Image.open(picture) as image:
            animated = getattr(image, "is_animated", False)
            small = image.convert("RGBA") if not animated else None
        if small is None:  # animations are embedded as they are
            kind = {".gif": "gif", ".webp": "webp"}.get(picture.suffix.lower(), "png")
            return f"data:image/{kind};base64,{base64.b64encode(picture.read_bytes()).decode()}"
        small.thumbnail((side, side), Image.Resampling.LANCZOS)
        encoded = io.BytesIO()
        # alpha quality stays at 100: fewer levels would make contours in the shadow
        small.save(encoded, format="WEBP", quality=82, method=2)
    except Exception:  # pillow raises all kinds of errors on damaged files, and none may stop the page
        return ""
    return f"data:image/webp;base64,{base64.b64encode(encoded.getvalue()).decode()}"


def _printable_name(name: str) -> str:
    """A file's name as printable text."""
    return printable(Path(name))
