"""The drawing of a color bar: a colormap from its low to its high limit, with ticks and the field's name."""

from __future__ import annotations

from itertools import groupby

import numpy as np

from z2p_core.coloring.colormaps import colormap_lut
from z2p_core.coloring.scales import ColorScale
from z2p_renderer.pipeline.legends.legend_page import LegendPage
from z2p_renderer.pipeline.legends.tick_labels import choose_ticks

_BAR_WIDTH = 1.3
"""Width of the bar; this and the following lengths are in heights of the font."""
_TICK_LENGTH = 0.4
_TICK_GAP = 0.35
"""Between a tick's line and its text."""
_LABEL_GAP = 0.7
"""Between the longest text of a tick and the field's name."""
_TICK_PITCH = 2.4
"""Least distance of two ticks."""
_MOST_TICKS = 6
_LINE_WIDTH = 0.07


def draw_color_bar(page: LegendPage, scale: ColorScale, font: float, left: float, margin: float) -> float:
    """Draws a color bar over the height of a page but for its margins.

    Args:
        page: the page.
        scale: the colors.
        font: size of the texts, points.
        left: where the bar begins, points.
        margin: empty space above and below the bar, points.

    Returns:
        Where the drawing ends on the right, points.
    """
    left, width = page.snap(left), page.snap(_BAR_WIDTH * font)
    top, bottom = page.snap(margin), page.snap(page.height - margin)
    _draw_colors(page, scale, (left, top, width, bottom - top))
    page.rectangle((left, top, width, bottom - top), None, _LINE_WIDTH * font)
    most = min(_MOST_TICKS, int((bottom - top) / (_TICK_PITCH * font)))
    right = left + width + _TICK_LENGTH * font
    widest = 0.0
    for value, text in zip(*choose_ticks(scale.low, scale.high, most), strict=True):
        y = _height_of(value, scale, top, bottom)
        page.line((left + width, y), (right, y), _LINE_WIDTH * font)
        page.text(right + _TICK_GAP * font, y, text, font, va="center_baseline")
        widest = max(widest, page.text_width(text, font))
    right += _TICK_GAP * font + widest
    return right + _draw_label(page, scale, font, right + _LABEL_GAP * font, (top, bottom))


def _draw_colors(page: LegendPage, scale: ColorScale, box: tuple[float, float, float, float]) -> None:
    """The colormap, the low end at the bottom.

    Each color is drawn from where it begins to the upper end, over the one before: stripes side by side would show
    seams in vector files.
    """
    left, top, width, height = box
    lut = colormap_lut(scale.colormap)
    starts = [next(group) for _, group in groupby(range(len(lut)), key=lambda level: tuple(lut[level]))]
    page.rectangles([(left, top, width, height * (1 - start / len(lut))) for start in starts], lut[starts])


def _height_of(value: float, scale: ColorScale, top: float, bottom: float) -> float:
    """Where a value stands on the bar, points from the page's upper edge; the middle if the limits are equal."""
    span = scale.high / 2 - scale.low / 2  # halves, as the difference of two large numbers may be infinite
    share = 0.5 if span <= 0 else (value / 2 - scale.low / 2) / span
    return bottom - float(np.clip(share, 0, 1)) * (bottom - top)


def _draw_label(page: LegendPage, scale: ColorScale, font: float, left: float, span: tuple[float, float]) -> float:
    """The field's name, with its unit in brackets, upwards beside the ticks; returns the width that it takes."""
    most = page.height - font
    unit = f" [{page.shorten(scale.unit, font, most / 2)}]" if scale.unit.strip() else ""
    name = page.shorten(scale.field, font, most - (page.text_width(unit, font) if unit else 0))
    label = f"{name}{unit}".strip()
    if not label:
        return 0.0
    page.text(left + 0.5 * font, sum(span) / 2, label, font, rotation=90, ha="center", va="center")
    return (_LABEL_GAP + 1) * font
