"""A rendered scan as a PDF or SVG file: the picture embedded, with its marks as vectors and its texts as text."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import RenderedScan
from z2p_renderer.storage.files.atomic_write import NotAFileError, atomic_write
from z2p_renderer.storage.images.image_files import PictureError


def write_document(rendered: RenderedScan, look: Look, record: Mapping[str, Any], path: Path) -> None:
    """Writes a scan that was rendered with `look.is_document`, as PDF or SVG by the path's suffix.

    Raises:
        PictureError: the path is that of something other than a file.
    """
    from z2p_renderer.pipeline.legends.annotate import encode_document  # late: slow to import

    kind = path.suffix.lower()[1:]
    content = encode_document(rendered.picture, rendered.annotations(look), kind, look.dpi, look.background,
                              dict(record))  # fmt: skip
    try:
        atomic_write(content, path)
    except NotAFileError as error:
        raise PictureError(str(error)) from None
