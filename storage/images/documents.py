"""PDF and SVG files that z2p wrote: the description that they hold, in which pictures keep their record."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.images.image_files import PictureError

MAX_DOCUMENT_BYTES = 1 << 28
"""Larger files are not searched."""
_PDF_SUBJECT = re.compile(rb"/Subject \(((?:[^()\\]|\\.)*)\)", re.DOTALL)
_SVG_DESCRIPTION = re.compile(r"<dc:description>(.*?)</dc:description>", re.DOTALL)
_PDF_ESCAPES = {"n": "\n", "r": "\r", "t": "\t", "b": "\b", "f": "\f"}


def document_description(path: Path) -> str | None:
    """The description in the metadata of a PDF or SVG file that z2p wrote; None if there is none.

    Raises:
        PictureError: the file cannot be read.
    """
    try:
        if path.stat().st_size > MAX_DOCUMENT_BYTES:
            return None
        content = path.read_bytes()
    except OSError as error:
        reason = error.strerror or error
        raise PictureError(f"{printable(path)}: {reason}; expected a picture written by z2p") from error
    if path.suffix.lower() == ".pdf":
        found = _PDF_SUBJECT.search(content)
        return None if found is None else re.sub(r"\\(.)", _unescaped, found[1].decode("latin-1"), flags=re.DOTALL)
    match = _SVG_DESCRIPTION.search(content.decode(errors="replace"))
    return None if match is None else unescape(match[1])


def _unescaped(escape: re.Match[str]) -> str:
    return _PDF_ESCAPES.get(escape[1], escape[1])
