"""Pictures on disk: PNG, WebP, JPEG and TIFF, written whole or not at all, with the record of what made them inside."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.messages import UserError
from z2p_core.images import bytes_from_unit, composite, unit_from_bytes
from z2p_renderer.storage.files.atomic_write import NotAFileError, atomic_write, file_kind
from z2p_renderer.storage.files.bounded_json import JsonError, read_json
from z2p_renderer.storage.files.printable_names import is_file, path_exists, printable
from z2p_renderer.storage.images.png import encode_png
from z2p_renderer.storage.images.record_schema import record_fault
from z2p_renderer.storage.scans.silenced_libraries import quiet

FORMATS = {".png": "PNG", ".webp": "WEBP", ".jpg": "JPEG", ".jpeg": "JPEG", ".tif": "TIFF", ".tiff": "TIFF"}
"""Suffix -> format."""
OPAQUE_SUFFIXES = frozenset({".jpg", ".jpeg", ".gif", ".mp4"})
"""Suffixes whose format has no soft transparency; white is put behind unless another background is asked for."""
RECORD_KEYWORD = "z2p"
"""Keyword of the PNG text chunk that holds the record, as JSON."""
DESCRIPTION_TAG = 0x010E
"""The EXIF and TIFF tag ImageDescription, which holds the record as ``z2p: {...}`` in the other formats."""
WHITE = (1.0, 1.0, 1.0)


class PictureError(UserError):
    """A picture file that cannot be used; the message says what was expected, what came, and what to do."""


def write_picture(
    picture: np.ndarray,
    path: Path,
    background: tuple[float, float, float] | None = None,
    record: dict[str, Any] | None = None,
) -> None:
    """Write a straight RGBA picture (H, W, 4) uint8 in the format of the suffix; opaque RGB over a background.

    PNG, WebP and TIFF keep every bit; JPEG has quality 95.

    Raises:
        PictureError: a suffix that stands for no format, or something other than a file lies there.
    """
    encoded = encode_picture(picture, path.suffix.lower(), background, record)
    try:
        atomic_write(encoded, path)
    except NotAFileError as error:
        raise PictureError(str(error)) from None


def encode_picture(
    picture: np.ndarray,
    suffix: str,
    background: tuple[float, float, float] | None = None,
    record: dict[str, Any] | None = None,
) -> bytes:
    """The file that `write_picture` writes; `suffix` is lower-case with its dot.

    Raises:
        PictureError: a suffix that stands for no format.
    """
    check_picture_suffix(suffix)
    if background is None and suffix in OPAQUE_SUFFIXES:
        background = WHITE
    if background is not None:
        picture = bytes_from_unit(composite(unit_from_bytes(picture), background))
    if suffix == ".png":
        return encode_png(picture, {} if record is None else {RECORD_KEYWORD: json.dumps(record, allow_nan=False)})
    from PIL import Image  # late: PNG, which most are, does without

    image, encoded = Image.fromarray(picture), io.BytesIO()
    image.save(encoded, format=FORMATS[suffix], **_encoder_options(FORMATS[suffix], record))
    return encoded.getvalue()


def check_picture_suffix(suffix: str) -> None:
    """Nothing, when a suffix (lower-case, with its dot) stands for a format.

    Raises:
        PictureError: it does not.
    """
    if suffix not in FORMATS:
        raise PictureError(f"expected a picture named {', '.join(FORMATS)}, got {suffix or 'no suffix'!r}")


def read_record(path: Path, *, complete: bool = False) -> dict[str, Any]:
    """The record inside a picture that z2p wrote; `complete` asks for all that it takes to draw it again.

    Raises:
        PictureError: no picture, one without a record (a picture editor may have dropped it), or with a record that
            cannot be one of z2p's.
    """
    text = _record_text(path)
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


def _record_text(path: Path) -> str | None:
    """The text of the record, where there is one."""
    from PIL import Image

    if path_exists(path) and not is_file(path):  # a pipe would be waited for
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
    except OSError as error:  # pillow's own error for what is no picture is one of these
        reason = error.strerror or "not a picture that can be read"
        raise PictureError(f"{printable(path)}: {reason}; expected a picture written by z2p") from error
    except Exception as error:  # pillow raises whatever a damaged file makes it stumble over
        reason = " ".join(str(error).split())[:200]
        raise PictureError(f"{printable(path)}: cannot be read ({type(error).__name__}: {reason})") from error
    ours = isinstance(text, str) and text.startswith(f"{RECORD_KEYWORD}: ")
    return str(text).removeprefix(f"{RECORD_KEYWORD}: ") if ours else None


def is_readable_picture(path: Path) -> bool:
    """Whether a file is a picture, all of which can be read."""
    from PIL import Image

    try:
        with quiet(), Image.open(path) as image:
            image.load()
    except Exception:  # pillow raises whatever a damaged file makes it stumble over
        return False
    return True


def is_truncated(path: Path) -> bool:
    """Whether a picture ends before its format says, told by its last bytes; those of a TIFF tell nothing."""
    with path.open("rb") as file:
        head = file.read(8)
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - 12))
        tail = file.read()
    if head.startswith(b"RIFF"):
        return size < 8 + int.from_bytes(head[4:8], "little")
    ends = {b"\x89PNG": tail[4:8] == b"IEND", b"\xff\xd8\xff": tail.endswith(b"\xff\xd9"),
            b"GIF8": tail.endswith(b";")}  # fmt: skip
    return not next((whole for begin, whole in ends.items() if head.startswith(begin)), True)


def record_text(record: dict[str, Any]) -> str:
    """The record as the text that stands in a description or a comment; plain ascii, which is all they hold."""
    return f"{RECORD_KEYWORD}: {json.dumps(record, allow_nan=False)}"


def _encoder_options(format: str, record: dict[str, Any] | None) -> dict[str, Any]:
    """Pillow's options for a format, the record among them."""
    from PIL import Image

    kinds: dict[str, dict[str, Any]] = {
        "WEBP": {"lossless": True, "exact": True},
        "JPEG": {"quality": 95, "subsampling": 0},
        "TIFF": {"compression": "tiff_adobe_deflate"},
    }
    options = kinds[format]
    if record is None:
        return options
    if format == "TIFF":
        return {**options, "description": record_text(record)}
    exif = Image.Exif()
    exif[DESCRIPTION_TAG] = record_text(record)
    return {**options, "exif": exif}
