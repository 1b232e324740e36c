"""A scale bar in the lower right corner of a picture: a line of a round length in the data's units."""

from __future__ import annotations

import math

from z2p_renderer.pipeline.legends.legend_page import LegendPage
from z2p_renderer.pipeline.legends.tick_labels import number_text

_MOST_SHARE = 0.3
"""Largest length of the bar, as a share of the picture's width."""
_ROUND_FACTORS = (5, 2, 1)
"""Lengths are one of these times a power of ten."""
_INSET = 0.9
"""From the picture's edges; this and the following lengths are in heights of the font."""
_TICK_HEIGHT = 0.5
_LINE_WIDTH = 0.14
_TEXT_GAP = 0.75
"""From the bar up to the middle of its text."""


def round_length(most: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is at most `most`, which is above 0."""
    power = 10.0 ** math.floor(math.log10(most) + 1e-9)
    return next(factor * power for factor in _ROUND_FACTORS if factor * power <= most * (1 + 1e-9))


def draw_scale_bar(
    page: LegendPage, box: tuple[float, float, float, float], points_per_unit: float, unit: str, font: float
) -> None:
    """Draws the bar, with its length above it.

    Args:
        page: the page.
        box: left, top, width and height of the picture on the page, points.
        points_per_unit: length of the data's unit at the middle of the object, points.
        unit: name of the data's unit; empty if it is not known.
        font: size of the text, points.
    """
    left, top, width, height = box
    length = round_length(_MOST_SHARE * width / points_per_unit)
    text = page.shorten(f"{number_text(length)} {unit}".strip(), font, width)
    span = length * points_per_unit
    reach = max(span, page.text_width(text, font))
    middle = left + width - _INSET * font - reach / 2
    y = top + height - _INSET * font
    begin, end = page.snap(middle - span / 2), page.snap(middle - span / 2) + span
    page.line((begin, y), (end, y), _LINE_WIDTH * font)
    for x in (begin, end):
        page.line((x, y - _TICK_HEIGHT / 2 * font), (x, y + _TICK_HEIGHT / 2 * font), _LINE_WIDTH * font)
    page.text(middle, y - _TEXT_GAP * font, text, font, ha="center", va="center_baseline")
