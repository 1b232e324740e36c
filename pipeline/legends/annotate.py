"""Pictures with all that is drawn onto them and beside them: scale bar, axes and color bar; as pixels or as documents.

In a PDF or SVG the picture is embedded as it is, and lines and texts are vectors and real text.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from z2p_core.coloring.scales import ClassColors, Color, ColorScale
from z2p_core.images import (
    bytes_from_unit,
    composite,
    premultiplied_from_straight,
    straight_from_premultiplied,
    unit_from_bytes,
)
from z2p_renderer.pipeline.legends.axes_box import draw_axes
from z2p_renderer.pipeline.legends.draw_legend import (
    FONT_POINTS,
    draw_onto,
    draw_scale,
    font_pixels_for,
    ink_on,
)
from z2p_renderer.pipeline.legends.legend_page import POINTS_PER_INCH, LegendPage, drawing_settings
from z2p_renderer.pipeline.legends.marks import FrameGeometry, Marks
from z2p_renderer.pipeline.legends.scale_bar import draw_scale_bar
from z2p_renderer.storage.images.image_files import format_record

DEFAULT_DPI = 300.0
"""Pixels of a picture for an inch of a document, unless the user says otherwise."""
_STRIP_FONTS = 2.6
"""Height of the strip below a trimmed picture that holds the scale bar, in heights of the font."""


@dataclass(frozen=True)
class Annotations:
    """What belongs to a picture beside its pixels."""

    geometry: FrameGeometry
    marks: Marks = field(default_factory=Marks)
    scale: ColorScale | ClassColors | None = None
    """What a color bar or legend beside the picture shows; None for none."""
    trimmed: bool = False
    """Whether the picture was trimmed, so that a scale bar has no room in it and gets a strip below."""


def annotate(picture: np.ndarray, annotations: Annotations, background: Color | None = None) -> np.ndarray:
    """The picture with its annotations as pixels.

    Args:
        picture: (H, W, 4) uint8, straight sRGB and alpha.
        annotations: what to draw; axes and scale bar lie over the picture, the color bar in a strip at its right.
        background: what the picture will stand on, sRGB in [0, 1]; None if that is transparent.

    Returns:
        (H', W', 4) uint8; larger by the strips.
    """
    if annotations.marks:
        font_pixels = font_pixels_for(picture.shape[0])
        if annotations.trimmed and annotations.marks.scale_bar:
            strip = np.zeros((round(_STRIP_FONTS * font_pixels), *picture.shape[1:]), np.uint8)
            picture = np.concatenate([picture, strip])
        height, width = picture.shape[:2]
        dpi = font_pixels * POINTS_PER_INCH / FONT_POINTS
        with drawing_settings():
            page = LegendPage(height * POINTS_PER_INCH / dpi, ink_on(background), dpi)
            _draw_marks(page, annotations, (width, height), POINTS_PER_INCH / dpi)
            page.finish(width * POINTS_PER_INCH / dpi)
            drawn = page.pixels()
        picture = over(drawn[:height, :width], picture)
    if annotations.scale is not None:
        picture = draw_onto(picture, annotations.scale, background)
    return picture


def encode_document(
    picture: np.ndarray, annotations: Annotations, kind: str, dpi: float | None = None,
    background: Color | None = None, record: dict[str, Any] | None = None,
) -> bytes:  # fmt: skip
    """The content of a PDF or SVG file with the picture and its annotations.

    Args:
        picture: (H, W, 4) uint8, straight sRGB and alpha, without annotations.
        annotations: what to draw onto it and beside it, as vectors and text.
        kind: ``pdf`` or ``svg``.
        dpi: pixels of the picture for an inch of the page; None for `DEFAULT_DPI`.
        background: color of the page, sRGB in [0, 1]; None if it is transparent.
        record: what made the picture; it is kept in the file's metadata.
    """
    point = POINTS_PER_INCH / (dpi or DEFAULT_DPI)
    height, width = picture.shape[:2]
    has_strip = annotations.trimmed and annotations.marks.scale_bar
    below = round(_STRIP_FONTS * FONT_POINTS / point) if has_strip else 0
    if background is not None:
        picture = bytes_from_unit(composite(unit_from_bytes(picture), background))
    with drawing_settings():
        page = LegendPage((height + below) * point, ink_on(background), dpi or DEFAULT_DPI)
        page.picture((0, 0, width * point, height * point), picture)
        if annotations.marks:
            _draw_marks(page, annotations, (width, height + below), point)
        right = width * point
        if annotations.scale is not None:
            right = draw_scale(page, annotations.scale, right + FONT_POINTS) + 0.8 * FONT_POINTS
        page.finish(right)
        return page.encode(kind, background, "" if record is None else format_record(record))


def _draw_marks(page: LegendPage, annotations: Annotations, size: tuple[int, int], point: float) -> None:
    """Draws axes and scale bar; `size` is the picture's in pixels, strip included, and `point` a pixel in points."""
    box = (0.0, 0.0, size[0] * point, size[1] * point)
    marks, geometry = annotations.marks, annotations.geometry
    if marks.axes:
        draw_axes(page, box, geometry, point, marks.unit, FONT_POINTS)
    if marks.scale_bar:
        draw_scale_bar(page, box, geometry.pixels_per_unit * point, marks.unit, FONT_POINTS)


def over(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    """A straight RGBA image (H, W, 4) uint8 over another one of the same size."""
    one, other = (premultiplied_from_straight(unit_from_bytes(image)) for image in (above, below))
    mixed = bytes_from_unit(straight_from_premultiplied(one + (1 - one[..., 3:]) * other))
    empty = above[..., 3:] == 0
    return np.where(empty, below, mixed)
