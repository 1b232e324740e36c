"""Legends of pictures: a color bar for scalars, names of classes for labels; in a picture or as a file of its own."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from z2p_core.coloring.scales import ClassColors, Color, ColorScale
from z2p_core.images import bytes_from_unit, composite, linear_from_srgb, unit_from_bytes
from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.legends.class_legend import class_legend_height, draw_class_legend
from z2p_renderer.pipeline.legends.color_bar import draw_color_bar
from z2p_renderer.pipeline.legends.legend_page import POINTS_PER_INCH, LegendPage, drawing_settings
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.files.printable_names import printable

LEGEND_SUFFIXES = (".svg", ".png", ".pdf")
"""Suffixes of legends as files of their own."""
FONT_POINTS = 8.0
"""Size of the texts in a file, as in figures of papers."""
_FONT_SHARE = 0.032
"""Size of the texts in a picture, of its height."""
_MIN_FONT_PIXELS = 10.0
"""Texts in small pictures are no smaller than this."""
_SMALLEST_FONT_PIXELS = 7.0
"""Texts of legends of many classes shrink to this before classes are left out."""
_FILE_BAR_POINTS = 160.0
"""Height of a color bar in a file."""
_FILE_MOST_ROWS = 24
"""Rows of classes in a file, before there are more columns."""
_FILE_MOST_COLUMNS = 16
"""Columns of classes in a file; classes beyond are counted, not shown."""
_FILE_MARGIN_POINTS = 6.0
"""Empty space around the legend in a file."""
_STRIP_BAR_MARGIN = 0.12
"""Empty space above and below a color bar in a picture, of its height."""
_STRIP_CLASSES_MARGIN = 0.02
"""Least empty space above and below a legend of classes in a picture, of its height."""
_STRIP_MOST_COLUMNS = 12
"""Columns of classes in a picture; classes beyond are counted, not shown."""
_MAX_STRIP_SHARE = 1.2
"""Width of the strip of a legend of classes, of the picture's height, beyond which its texts shrink."""
_DARK_INK: Color = (0.13, 0.13, 0.13)
_LIGHT_INK: Color = (0.93, 0.93, 0.93)


def draw_onto(picture: np.ndarray, scale: ColorScale | ClassColors, background: Color | None = None) -> np.ndarray:
    """The picture with a strip at its right that holds the legend; nothing of the picture is covered.

    The strip is transparent, but in an opaque picture it has the background's color, or is white without one. Texts
    are dark, or light if the background is dark; their size follows the picture's height.

    Args:
        picture: (H, W, 4) uint8, straight sRGB and alpha.
        scale: the colors of the picture's points.
        background: what the picture stands on or will stand on, sRGB in [0, 1]; None if that is transparent.

    Returns:
        (H, W + strip, 4) uint8.

    Raises:
        SettingError: no colormap has the scale's name.
    """
    strip = _cached_strip(scale, picture.shape[0], ink_on(background))
    if (picture[..., 3] == 255).all():
        strip = _opaque(strip, (1.0, 1.0, 1.0) if background is None else background)
    return np.concatenate([picture, strip], axis=1)


def write_legend(scale: ColorScale | ClassColors, path: Path, background: Color | None = None) -> Path:
    """Writes a legend as a file of its own: vectors and text in SVG and PDF, 300 pixels an inch in PNG.

    The same legend is the same file, byte for byte. Without a background it is transparent and its texts are dark.

    Raises:
        SettingError: the file's suffix is none of `LEGEND_SUFFIXES`, or no colormap has the scale's name.
    """
    check_legend_path(path)
    with drawing_settings():
        page, width = _lay_out_file(scale, ink_on(background))
        page.finish(width)
        content = page.encode(path.suffix.lower()[1:], background)
    return atomic_write(content, path)


def check_legend_path(path: Path) -> None:
    """Makes sure that a legend can have the name.

    Raises:
        SettingError: its suffix is none of `LEGEND_SUFFIXES`.
    """
    if path.suffix.lower() not in LEGEND_SUFFIXES:
        raise SettingError(f"expected a legend's file to end in {', '.join(LEGEND_SUFFIXES[:-1])} or "
                           f"{LEGEND_SUFFIXES[-1]}, got {printable(path)}")


def ink_on(background: Sequence[float] | None) -> Color:
    """The color of texts on a background, sRGB in [0, 1]: of a dark and a light grey, the one with more contrast."""
    if background is None:
        return _DARK_INK
    page = _luminance(background)
    contrasts = {ink: (max(page, _luminance(ink)) + 0.05) / (min(page, _luminance(ink)) + 0.05)  # as in WCAG 2
                 for ink in (_DARK_INK, _LIGHT_INK)}  # fmt: skip
    return max(contrasts, key=contrasts.__getitem__)


def _luminance(color: Sequence[float]) -> float:
    """Relative luminance in [0, 1] of an sRGB color."""
    return float(linear_from_srgb(np.asarray(color, dtype=np.float64)) @ np.array([0.2126, 0.7152, 0.0722]))


@lru_cache(maxsize=8)
def _cached_strip(scale: ColorScale | ClassColors, height: int, ink: Color) -> np.ndarray:
    """The legend on a transparent strip (height, width, 4) uint8; kept, as all pictures of a series have the same."""
    font_pixels = font_pixels_for(height)
    with drawing_settings():
        page, width = _lay_out_strip(scale, height, ink, font_pixels)
        while (isinstance(scale, ClassColors) and font_pixels > _SMALLEST_FONT_PIXELS
               and width > _MAX_STRIP_SHARE * page.height):  # fmt: skip
            font_pixels = max(_SMALLEST_FONT_PIXELS, 0.8 * font_pixels)
            page, width = _lay_out_strip(scale, height, ink, font_pixels)
        page.finish(width)
        strip = page.pixels()
    strip.setflags(write=False)
    return strip


def _lay_out_strip(
    scale: ColorScale | ClassColors, height: int, ink: Color, font_pixels: float
) -> tuple[LegendPage, float]:
    """The legend on a page as high as a picture of a height in pixels, and the width of it, points."""
    dpi = font_pixels * POINTS_PER_INCH / FONT_POINTS
    page = LegendPage(height * POINTS_PER_INCH / dpi, ink, dpi)
    return page, draw_scale(page, scale, FONT_POINTS) + 0.8 * FONT_POINTS


def draw_scale(page: LegendPage, scale: ColorScale | ClassColors, left: float) -> float:
    """Draws a color bar or legend of a page's height from `left` on; returns where it ends, both in points."""
    if isinstance(scale, ColorScale):
        return draw_color_bar(page, scale, FONT_POINTS, left, _STRIP_BAR_MARGIN * page.height)
    margin = _STRIP_CLASSES_MARGIN * page.height
    return draw_class_legend(page, scale, FONT_POINTS, left, margin, _STRIP_MOST_COLUMNS)


def font_pixels_for(height: int) -> float:
    """Size of the texts in a picture of a height, both in pixels."""
    return max(_MIN_FONT_PIXELS, _FONT_SHARE * height)


def _lay_out_file(scale: ColorScale | ClassColors, ink: Color) -> tuple[LegendPage, float]:
    """The legend on a page of its own, and the width of it, points."""
    margin = _FILE_MARGIN_POINTS
    if isinstance(scale, ColorScale):
        page = LegendPage(_FILE_BAR_POINTS + 2 * margin, ink)
        return page, draw_color_bar(page, scale, FONT_POINTS, margin, margin) + margin
    rows = min(len(scale.entries), _FILE_MOST_ROWS)
    page = LegendPage(class_legend_height(rows, FONT_POINTS) + 2 * margin, ink)
    return page, draw_class_legend(page, scale, FONT_POINTS, margin, margin, _FILE_MOST_COLUMNS) + margin


def _opaque(strip: np.ndarray, background: Color) -> np.ndarray:
    """The strip over a background."""
    colors = bytes_from_unit(composite(unit_from_bytes(strip), background))
    return np.concatenate([colors, np.full_like(strip[..., :1], 255)], axis=2)
