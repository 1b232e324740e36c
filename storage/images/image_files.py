"""Pictures on disk: PNG, WebP, JPEG and TIFF, written atomically, each with a record of what made it inside."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.messages import UserError, error_reason
from z2p_core.images import bytes_from_unit, composite, unit_from_bytes
from z2p_renderer.storage.files.atomic_write import NotAFileError, atomic_write, file_kind
from z2p_renderer.storage.files.bounded_json import JsonError, read_json
from z2p_renderer.storage.files.printable_names import is_file, path_exists, printable
from z2p_renderer.storage.images.png import encode_png
from z2p_renderer.storage.images.record_schema import record_fault
from z2p_renderer.storage.scans.silenced_libraries import quiet

FORMATS = {".png": "PNG", ".webp": "WEBP", ".jpg": "JPEG", ".jpeg": "JPEG", ".tif": "TIFF", ".tiff": "TIFF"}
"""Suffix -> format, by pillow's name for it."""
DOCUMENT_SUFFIXES = (".pdf", ".svg")
"""Suffixes of documents that embed a picture; `storage.images.documents` reads their records."""
OPAQUE_SUFFIXES = frozenset({".jpg", ".jpeg", ".gif", ".mp4"})
"""Suffixes of formats without partial transparency; pictures in them get a white background if none is given."""
RECORD_KEYWORD = "z2p"
"""Keyword of the PNG text chunk that holds the record, as JSON."""
DESCRIPTION_TAG = 0x010E
"""The EXIF and TIFF tag ImageDescription, which holds the record as ``z2p: {...}`` in formats other than PNG."""
WHITE = (1.0, 1.0, 1.0)


class PictureError(UserError):
    """A picture file that cannot be used; the message says what was expected, what was found, and what to do."""


def write_picture(
    picture: np.ndarray,
    path: Path,
    background: tuple[float, float, float] | None = None,
    record: dict[str, Any] | None = None,
    dpi: float | None = None,
) -> None:
    """Writes a picture (H, W, 4) uint8, straight RGBA, in the format of the path's suffix.

    With a `background` (sRGB in [0, 1]) the file is opaque RGB. PNG, WebP and TIFF are lossless; JPEG has quality 95.
    `dpi`, the pixels of an inch on paper, is noted in PNG, TIFF and JPEG; WebP has no place for it.

    Raises:
        PictureError: the suffix stands for no supported format, or the path is that of something other than a file.
    """
    encoded = encode_picture(picture, path.suffix.lower(), background, record, dpi)
    try:
        atomic_write(encoded, path)
    except NotAFileError as error:
        raise PictureError(str(error)) from None


def encode_picture(
    picture: np.ndarray,
    suffix: str,
    background: tuple[float, float, float] | None = None,
    record: dict[str, Any] | None = None,
    dpi: float | None = None,
) -> bytes:
    """The content of the file that `write_picture` writes; `suffix` is in lower case, with its dot.

    Raises:
        PictureError: the suffix stands for no supported format.
    """
    check_picture_suffix(suffix)
    if background is None and suffix in OPAQUE_SUFFIXES:
        background = WHITE
    if background is not None:
        picture = bytes_from_unit(composite(unit_from_bytes(picture), background))
    if suffix == ".png":
        texts = {} if record is None else {RECORD_KEYWORD: json.dumps(record, allow_nan=False)}
        return encode_png(picture, texts, dpi)
    from PIL import Image  # imported late: PNG, the usual format, does not need it

    image, encoded = Image.fromarray(picture), io.BytesIO()
    resolution = {} if dpi is None or FORMATS[suffix] == "WEBP" else {"dpi": (dpi, dpi)}
    image.save(encoded, format=FORMATS[suffix], **_encoder_options(FORMATS[suffix], record), **resolution)
    return encoded.getvalue()


def check_picture_suffix(suffix: str) -> None:
    """Makes sure that a suffix (in lower case, with its dot) stands for a supported format.

    Raises:
        PictureError: it does not.
    """
    if suffix not in FORMATS:
        raise PictureError(f"expected a picture named {', '.join(FORMATS)}, got {suffix or 'no suffix'!r}")


def read_record(path: Path, *, complete: bool = False) -> dict[str, Any]:
    """The record inside a picture that z2p wrote; `complete` requires all parts that `z2p rerender` needs.

    Raises:
        PictureError: the file is no picture, has no record (picture editors may drop it), or has an invalid one.
    """
    if path.suffix.lower() in DOCUMENT_SUFFIXES:
        from z2p_renderer.storage.images.documents import document_description

        text = _without_keyword(document_description(path))
    else:
        text = _read_record_text(path)
    if text is None:
        raise PictureError(f"{printable(path)}: holds no record of z2p; another program wrote it, or saved it again "
                           "without its text")
    try:
        record = read_json(text)
    except JsonError as error:
        raise PictureError(f"{printable(path)}: its record cannot be read: {error}") from None
    if fault := record_fault(record, complete=complete):
        raise PictureError(f"{printable(path)}: its record cannot be used: {fault}; another program changed it, or "
                           "another version of z2p wrote it")
    return dict(record)


def _read_record_text(path: Path) -> str | None:
    """The record of a picture as JSON text; None if there is none."""
    from PIL import Image

    if path_exists(path) and not is_file(path):  # reading a pipe would wait
        raise PictureError(f"{printable(path)}: expected a picture written by z2p, got {file_kind(path)}")
    try:
        with quiet(), Image.open(path) as image:
            text = image.info.get(RECORD_KEYWORD)
            if text is not None:
                return str(text)
            text = image.getexif().get(DESCRIPTION_TAG)
            if text is None and isinstance(comment := image.info.get("comment"), bytes):  # a GIF's
                text = comment.decode(errors="replace")
            if text is None and hasattr(image, "tag_v2"):
                text = image.tag_v2.get(DESCRIPTION_TAG)
    except OSError as error:  # so is pillow's error for files that are no pictures
        reason = error.strerror or "not a picture that can be read"
        raise PictureError(f"{printable(path)}: {reason}; expected a picture written by z2p") from error
    except Exception as error:  # pillow raises all kinds of errors on damaged files
        reason = f"{type(error).__name__}: {error_reason(error)}"
        raise PictureError(f"{printable(path)}: cannot be read ({reason})") from error
    return _without_keyword(text)


def _without_keyword(text: Any) -> str | None:
    """The record in a description, as JSON text; None if it holds none."""
    is_record = isinstance(text, str) and text.startswith(f"{RECORD_KEYWORD}: ")
    return str(text).removeprefix(f"{RECORD_KEYWORD}: ") if is_record else None


def is_readable_picture(path: Path) -> bool:
    """Whether a file is a picture that can be decoded completely."""
    from PIL import Image

    try:
        with quiet(), Image.open(path) as image:
            image.load()
    except Exception:  # pillow raises all kinds of errors on damaged files
        return False
    return True


def is_truncated(path: Path) -> bool:
    """Whether a picture file is cut off, judged by its last bytes; False for TIFF, which has no end mark."""
    with path.open("rb") as file:
        head = file.read(8)
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - 12))
        tail = file.read()
    if head.startswith(b"RIFF"):
        return size < 8 + int.from_bytes(head[4:8], "little")
    has_end_mark = {b"\x89PNG": tail[4:8] == b"IEND", b"\xff\xd8\xff": tail.endswith(b"\xff\xd9"),
            b"GIF8": tail.endswith(b";")}  # fmt: skip
    return not next((has_end for start, has_end in has_end_mark.items() if head.startswith(start)), True)


def format_record(record: dict[str, Any]) -> str:
    """The record as text for a description or comment field, which hold ASCII only."""
    return f"{RECORD_KEYWORD}: {json.dumps(record, allow_nan=False)}"


def _encoder_options(format: str, record: dict[str, Any] | None) -> dict[str, Any]:
    """Pillow's options for saving in a format, including the record."""
    from PIL import Image

    options_of: dict[str, dict[str, Any]] = {
        "WEBP": {"lossless": True, "exact": True},
        "JPEG": {"quality": 95, "subsampling": 0},
        "TIFF": {"compression": "tiff_adobe_deflate"},
    }
    options = options_of[format]
    if record is None:
        return options
    if format == "TIFF":
        return {**options, "description": format_record(record)}
    exif = Image.Exif()
    exif[DESCRIPTION_TAG] = format_record(record)
    return {**options, "exif": exif}
