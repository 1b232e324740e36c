"""A gallery: one HTML page that holds all pictures of a folder and the settings of each, and needs nothing else."""

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
"""Up to so many pictures are shown with sides of so many pixels; a page of thousands must still open."""
MIN_THUMBNAIL_SIDE = 160
GENERATOR_TAG, HEAD_BYTES = b'name="generator" content="z2p', 2000
"""What tells a page of z2p within its first so many bytes."""


def write_gallery(pictures: Sequence[Path], path: Path, title: str = "") -> Path:
    """The path, once the page with all the pictures is written there.

    The pictures are inside, reduced; each name links to its file beside the page.

    Raises:
        PictureError: another file is there; see `check_gallery_place`.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    check_gallery_place(path)
    environment = Environment(loader=PackageLoader("z2p_renderer.pipeline"), autoescape=True, undefined=StrictUndefined)
    side = next((side for most, side in THUMBNAIL_SIDES if len(pictures) <= most), MIN_THUMBNAIL_SIDE)
    cards = [_card(picture, path.parent, side) for picture in pictures]
    page = environment.get_template("gallery.html").render(
        title=title or f"{_text(path.absolute().parent.name)} - z2p", cards=cards, version=__version__
    )
    atomic_write(page.encode(errors="xmlcharrefreplace"), path)  # records may hold halves of a pair
    return path


def check_gallery_place(path: Path) -> None:
    """Makes sure that a gallery replaces nothing but a gallery.

    Raises:
        PictureError: a file of that name is something else.
    """
    if path.exists() and GENERATOR_TAG not in path.read_bytes()[:HEAD_BYTES]:
        raise PictureError(f"{printable(path)} is there already, and no gallery of z2p: rename it, or choose another "
                           "folder")


def _card(picture: Path, folder: Path, side: int) -> dict[str, Any]:
    """What the page shows of one picture; of one that cannot be read, that it cannot."""
    try:
        record = read_record(picture)
    except PictureError:  # a picture from elsewhere is shown without settings
        record = {}
    beside = os.path.relpath(picture, folder)
    settings, image = _settings(record), _data_uri(picture, side)
    if not image:
        settings = [("file", "cannot be read as a picture"), *settings]
    color = record.get("controls", {}).get("color", ())
    shown = len(color) == 3 and all(0 <= channel <= 1 for channel in color)
    text = " ".join([_text(beside), *(f"{key} {value}" for key, value in settings)]).lower()
    return {
        "name": _text(Path(beside).with_suffix("").as_posix()),
        "href": quote(Path(beside).as_posix().encode(errors="surrogateescape")),
        "image": image,
        "settings": settings,
        "swatch": "#" + "".join(f"{round(255 * channel):02x}" for channel in color) if shown else "",
        "text": text,
    }


def _settings(record: dict[str, Any]) -> list[tuple[str, str]]:
    """Rows of the settings' table, in words."""
    if not record:
        return []
    stance, controls = record.get("stance", {}), record.get("controls", {})
    rows = [("scan", _text(str(record.get("input", {}).get("name") or "an array")))]
    rows += [(name, ", ".join(f"{number:g}" for number in (round(x, 3) for x in value)))
             for name, value in controls.items()]  # fmt: skip
    rows += [("up", _text(f"{stance.get('up', '')}: {stance.get('up_reason', '')}")),
             ("view", f"azimuth {stance.get('azimuth') or 0:.0f}, {stance.get('view_reason', '')}")]  # fmt: skip
    if stance.get("outliers"):
        rows.append(("left out", f"strays: {stance['outliers']}"))
    rows += placement_rows(record)
    weights = record.get("weights", {})
    rows.append(("weights", f"{weights.get('name', '')} {str(weights.get('sha256', ''))[:12]}"))
    rows.append(("made by", f"z2p {record.get('version', '')}"))
    return rows


def placement_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What was asked of the cloud beyond the usual, in words; empty when nothing was."""
    placing = record.get("placing", {})
    rows = []
    if placing.get("cut_top"):
        rows.append(("cut off", f"{placing['cut_top']:g} % of the height, from above"))
    if placing.get("keep_outliers"):
        rows.append(("kept", "strays, and what lies far behind"))
    if isinstance(record.get("margin"), int | float):
        rows.append(("margin", f"{100 * record['margin']:g} % of the shorter side"))
    return rows


def _data_uri(picture: Path, side: int) -> str:
    """A data URI of the picture, made smaller; WebP, which every browser of today reads. Empty where it is none."""
    try:
        if not picture.is_file():  # a pipe would be waited for
            return ""
        with quiet(), Image.open(picture) as image:
            animated = getattr(image, "is_animated", False)
            small = image.convert("RGBA") if not animated else None
        if small is None:  # moving pictures go in as they are
            kind = {".gif": "gif", ".webp": "webp"}.get(picture.suffix.lower(), "png")
            return f"data:image/{kind};base64,{base64.b64encode(picture.read_bytes()).decode()}"
        small.thumbnail((side, side), Image.Resampling.LANCZOS)
        encoded = io.BytesIO()
        # alpha in full: fewer steps make contours in the shadow
        small.save(encoded, format="WEBP", quality=82, method=2)
    except Exception:  # pillow raises whatever a damaged file makes it stumble over, and no file may stop the others
        return ""
    return f"data:image/webp;base64,{base64.b64encode(encoded.getvalue()).decode()}"


def _text(name: str) -> str:
    """A file's name as printable text."""
    return printable(Path(name))
