"""The drawing of a legend of classes: a swatch and a name for each, in as many columns as it takes."""

from __future__ import annotations

from collections.abc import Sequence

from z2p_core.coloring.scales import ClassColors, ClassEntry
from z2p_renderer.pipeline.legends.legend_page import LegendPage

_ROW_PITCH = 1.65
"""Distance of two rows; this and the following lengths are in heights of the font."""
_SWATCH = 1.05
"""Side of a swatch."""
_NAME_GAP = 0.55
"""Between a swatch and its name."""
_COLUMN_GAP = 1.2
_LINE_WIDTH = 0.05
_NAME_WIDTHS = (16.0, 12.0, 9.0, 7.0)
"""Widths to which names are shortened in a legend of one, two, three, or more columns."""
_TITLE_WIDTH = 18.0
"""Width to which the title is shortened over a single narrow column."""


def class_legend_height(rows: int, font: float) -> float:
    """The height of a title and rows of classes below it; lengths in points."""
    return (rows + 1) * _ROW_PITCH * font


def draw_class_legend(
    page: LegendPage, colors: ClassColors, font: float, left: float, margin: float, most_columns: int | None = None
) -> float:
    """Draws a legend of classes below the field's name, in the middle of a page's height.

    Args:
        page: the page.
        colors: the classes.
        font: size of the texts, points.
        left: where the legend begins, points.
        margin: least empty space above and below, points.
        most_columns: columns at most; where these do not hold all classes, the last line tells how many are left out.

    Returns:
        Where the drawing ends on the right, points.
    """
    most_rows = max(1, int((page.height - 2 * margin) / (_ROW_PITCH * font) + 1e-6) - 1)
    entries, left_out = _entries_that_fit(colors.entries, most_rows, most_columns)
    lines = len(entries) + bool(left_out)
    columns = max(1, -(-lines // most_rows))
    rows = -(-lines // columns) if lines else 0
    top = (page.height - class_legend_height(rows, font)) / 2
    x, right = left, left
    for first in range(0, lines, max(rows, 1)):
        column = entries[first : first + rows]
        right = max(right, _draw_column(page, column, font, (x, top + _ROW_PITCH * font), columns))
        if left_out and first + rows >= lines:
            y = top + (len(column) + 1.5) * _ROW_PITCH * font
            right = max(right, _draw_text(page, f"… and {left_out:,} more", font, x, y))
        x = right + _COLUMN_GAP * font
    title = page.shorten(colors.field, font, max(_TITLE_WIDTH * font, right - left))
    return max(right, _draw_text(page, title, font, left, top + 0.5 * _ROW_PITCH * font))


def _entries_that_fit(
    entries: Sequence[ClassEntry], rows: int, columns: int | None
) -> tuple[Sequence[ClassEntry], int]:
    """The first entries that rows and columns hold, and how many are left out; a line is kept to say so."""
    if columns is None or len(entries) <= rows * columns:
        return entries, 0
    kept = rows * columns - 1
    return entries[:kept], len(entries) - kept


def _draw_column(
    page: LegendPage, entries: Sequence[ClassEntry], font: float, corner: tuple[float, float], columns: int
) -> float:
    """Swatches and names below each other from a corner on; returns where the longest name ends."""
    left, top = page.snap(corner[0]), corner[1]
    side, right = page.snap(_SWATCH * font), corner[0]
    most = _NAME_WIDTHS[min(columns, len(_NAME_WIDTHS)) - 1] * font
    for row, entry in enumerate(entries):
        middle = top + (row + 0.5) * _ROW_PITCH * font
        page.rectangle((left, page.snap(middle - side / 2), side, side), entry.color, _LINE_WIDTH * font)
        name = page.shorten(entry.name, font, most) or str(entry.value)
        right = max(right, _draw_text(page, name, font, left + side + _NAME_GAP * font, middle))
    return right


def _draw_text(page: LegendPage, text: str, font: float, left: float, middle: float) -> float:
    """A line of text, whose middle has a height; returns where it ends."""
    page.text(left, middle, text, font, va="center_baseline")
    return left + page.text_width(text, font)
