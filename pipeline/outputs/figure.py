"""The page of a figure: pictures in rows and columns with titles and a color bar; as pixels, as PDF or SVG."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from z2p_core.coloring.scales import Color
from z2p_core.images import bytes_from_unit, composite, unit_from_bytes
from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.coloring.color_points import Scale
from z2p_renderer.pipeline.legends.annotate import over
from z2p_renderer.pipeline.legends.draw_legend import FONT_POINTS, draw_scale, ink_on
from z2p_renderer.pipeline.legends.legend_page import POINTS_PER_INCH, LegendPage, drawing_settings
from z2p_renderer.pipeline.outputs.figure_cells import Place
from z2p_renderer.storage.figure_tables import FigureTable

MM_PER_INCH = 25.4
TITLE_FONTS = 1.7
"""Height of the strip of columns' titles, and width of that of rows' titles, in heights of the font."""
GAP_POINTS = 3.0
"""Space between cells."""
MIN_CELL_PIXELS = 32
MAX_PAGE_PIXELS = 16000
"""Longest side of a figure."""


@dataclass(frozen=True)
class FigureLayout:
    """Where everything lies on the page; lengths are pixels."""

    cell: tuple[int, int]
    """Width and height of a cell."""
    gap: int
    left: int
    """Width of the rows' titles."""
    top: int
    """Height of the columns' titles."""
    dpi: float
    font: float = FONT_POINTS
    """Size of the texts, points."""

    def corner(self, row: int, column: int) -> tuple[int, int]:
        """Left and top of a cell."""
        return self.left + column * (self.cell[0] + self.gap), self.top + row * (self.cell[1] + self.gap)

    def size(self, table: FigureTable) -> tuple[int, int]:
        """Width and height of titles and cells."""
        right, bottom = self.corner(len(table.rows), len(table.columns))
        return right - self.gap, bottom - self.gap


def lay_out(
    table: FigureTable, cell: tuple[int, int], dpi: float, font: float = FONT_POINTS, width_mm: float | None = None,
    scale: Scale | None = None,
) -> FigureLayout:  # fmt: skip
    """The layout of a table.

    Args:
        table: the figure's.
        cell: width and height of a cell, pixels; with `width_mm` only their ratio counts.
        dpi: pixels of an inch.
        font: size of the texts, points.
        width_mm: width of the whole figure, color bar included, millimetres; None leaves it to the cells.
        scale: what a color bar shows; None for none.

    Raises:
        SettingError: cells would have fewer than 32 pixels, or the figure more than 16,000 a side.
    """
    pixels = dpi / POINTS_PER_INCH
    left = round(TITLE_FONTS * font * pixels) if any(table.rows) else 0
    top = round(TITLE_FONTS * font * pixels) if any(table.columns) else 0
    layout = FigureLayout(cell, round(GAP_POINTS * pixels), left, top, dpi, font)
    if width_mm is not None:
        for _ in range(2):  # the bar's width depends a little on its height, and that on the cells
            bar = _bar_width(layout, table, scale)
            columns = len(table.columns)
            room = width_mm / MM_PER_INCH * dpi - bar - left - (columns - 1) * layout.gap
            side = int(room / columns)
            if side < MIN_CELL_PIXELS:
                raise SettingError(f"{width_mm:g} mm at {dpi:g} dpi leave {side} pixels for each of {columns} columns; "
                                   f"expected {MIN_CELL_PIXELS} at least: choose another width or dpi")
            layout = FigureLayout((side, round(side * cell[1] / cell[0])), layout.gap, left, top, dpi, font)
    if max(layout.size(table)) > MAX_PAGE_PIXELS:
        raise SettingError(f"the figure would have {layout.size(table)} pixels; expected at most {MAX_PAGE_PIXELS} a "
                           "side: make its cells smaller (--resolution), or its --width-mm or --dpi")
    return layout


class FigurePage:
    """The page of a table, whose pictures may be exchanged for those of a film's next frame."""

    def __init__(
        self, table: FigureTable, layout: FigureLayout, scale: Scale | None = None, background: Color | None = None
    ) -> None:  # fmt: skip
        self._table, self._layout, self._scale, self._background = table, layout, scale, background
        self._overlay: np.ndarray | None = None

    def pixels(self, pictures: Mapping[Place, np.ndarray]) -> np.ndarray:
        """The figure (H, W, 4) uint8 with a picture (H, W, 4) uint8 of the cells' size for each place."""
        if self._overlay is None:
            with drawing_settings():
                self._overlay = self._page({}).pixels()
        below = np.zeros_like(self._overlay)
        for place, picture in pictures.items():
            left, top = self._layout.corner(*place)
            below[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
        return over(self._overlay, below)

    def document(self, pictures: Mapping[Place, np.ndarray], kind: str) -> bytes:
        """The content of a file of a kind, ``pdf`` or ``svg``: pictures are embedded, titles are text."""
        with drawing_settings():
            return self._page(pictures).encode(kind, self._background)

    def _page(self, pictures: Mapping[Place, np.ndarray]) -> LegendPage:
        layout, table, point = self._layout, self._table, POINTS_PER_INCH / self._layout.dpi
        width, height = layout.size(table)
        page = LegendPage(height * point, ink_on(self._background), layout.dpi)
        for place, picture in pictures.items():
            if self._background is not None:
                picture = bytes_from_unit(composite(unit_from_bytes(picture), self._background))
            left, top = layout.corner(*place)
            page.picture((left * point, top * point, layout.cell[0] * point, layout.cell[1] * point), picture)
        self._draw_titles(page, point)
        right = width * point
        if self._scale is not None:
            right = draw_scale(page, self._scale, right + layout.font) + 0.2 * layout.font
        page.finish(right)
        return page

    def _draw_titles(self, page: LegendPage, point: float) -> None:
        layout, font = self._layout, self._layout.font
        wide, high = layout.cell[0] * point, layout.cell[1] * point
        for column, title in enumerate(self._table.columns):
            middle = layout.corner(0, column)[0] * point + wide / 2
            text = page.shorten(title, font, wide)
            page.text(middle, layout.top * point / 2, text, font, ha="center", va="center_baseline")
        for row, title in enumerate(self._table.rows):
            middle = layout.corner(row, 0)[1] * point + high / 2
            text = page.shorten(title, font, high)
            page.text(layout.left * point / 2, middle, text, font, rotation=90, ha="center", va="center")


def _bar_width(layout: FigureLayout, table: FigureTable, scale: Scale | None) -> float:
    """Width of the color bar beside the cells, pixels."""
    if scale is None:
        return 0.0
    point = POINTS_PER_INCH / layout.dpi
    with drawing_settings():
        page = LegendPage(layout.size(table)[1] * point, ink_on(None), layout.dpi)
        return (draw_scale(page, scale, layout.font) + 0.2 * layout.font) / point
