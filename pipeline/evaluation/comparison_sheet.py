"""Comparison sheets of an evaluation: one row per view with the input, the methods' pictures and the ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.images import bytes_from_unit, composite
from z2p_core.interfaces import ZBuffer
from z2p_renderer.pipeline.outputs.contact_sheet import (
    SHEET_KEYWORD,
    check_sheet_places,
    remove_surplus_sheets,
    sheet_path,
)
from z2p_renderer.pipeline.outputs.point_preview import draw_dots

COLUMNS = ("cloud", "z-buffer (Eq. 1)", "picture", "ground truth")
"""Column titles; those of further methods come before the ground truth."""
ROWS_PER_SHEET = 12
CELL_SIDE = 192
"""Side of a cell, pixels."""
CELL_GAP = 6
"""Gap between cells, pixels."""
LABEL_WIDTH = 150
"""Width of the column of labels, pixels."""
TITLE_HEIGHT = 24
"""Height of the line of titles, pixels."""
TEXT_COLOR = (40, 40, 40)


@dataclass(frozen=True)
class SheetRow:
    """One view: label lines, and a cell (CELL, CELL, 3) uint8 for each column."""

    label: tuple[str, ...]
    cells: tuple[np.ndarray, ...]


def make_row(
    label: tuple[str, ...],
    cloud: np.ndarray,
    elevation: float,
    prediction: np.ndarray,
    truth: np.ndarray,
    others: Sequence[np.ndarray] = (),
) -> SheetRow:
    """Row with a placed cloud (N, 3) seen from `elevation` degrees, its z-buffer, and pictures composited on white.

    The pictures (H, W, 4) are straight sRGB RGBA, float in [0, 1], all of one size. The z-buffer is the paper's,
    whichever one the weights read.
    """
    height, width = truth.shape[:2]
    zbuffer: ZBuffer = registry.load("zbuffers", "paper")()
    depth = np.clip(zbuffer.draw(cloud, Camera(width, height, elevation))[0], 0, 1)
    pictures = (
        draw_dots(cloud, Camera(CELL_SIDE, CELL_SIDE, elevation)),
        np.repeat(depth[..., None], 3, axis=2),
        *(composite(picture, (1.0, 1.0, 1.0)) for picture in (prediction, *others, truth)),
    )
    return SheetRow(label, tuple(_resize_to_cell(bytes_from_unit(picture)) for picture in pictures))


def write_sheets(rows: Sequence[SheetRow], out: Path, others: Sequence[str] = ()) -> list[Path]:
    """Writes ``out/sheet.png``, and ``sheet_2.png`` etc. for more than `ROWS_PER_SHEET` rows; deletes older sheets.

    `others` are the titles of the further methods.

    Raises:
        SettingError: a sheet's path holds another file; see `check_sheet_places`.
    """
    check_sheet_places(out, count_sheets(len(rows)))
    titles = (*COLUMNS[:-1], *others, COLUMNS[-1])
    paths: list[Path] = []
    for first in range(0, len(rows), ROWS_PER_SHEET):
        path, text = sheet_path(out, len(paths) + 1), PngInfo()
        text.add_text(SHEET_KEYWORD, path.name)
        _draw_sheet(rows[first : first + ROWS_PER_SHEET], titles).save(path, pnginfo=text)
        paths.append(path)
    remove_surplus_sheets(out, len(paths))
    return paths


def count_sheets(rows: int) -> int:
    """Number of sheets for a number of rows."""
    return -(-rows // ROWS_PER_SHEET)


def _draw_sheet(rows: Sequence[SheetRow], titles: Sequence[str]) -> Image.Image:
    step = CELL_SIDE + CELL_GAP
    sheet = Image.new("RGB", (LABEL_WIDTH + len(titles) * step, TITLE_HEIGHT + len(rows) * step), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    for column, title in enumerate(titles):
        center = (LABEL_WIDTH + column * step + CELL_SIDE // 2, TITLE_HEIGHT // 2)
        pen.text(center, title, TEXT_COLOR, font, anchor="mm")
    for index, row in enumerate(rows):
        top = TITLE_HEIGHT + index * step
        label = "\n".join(_cut_to_width(line, pen, font) for line in row.label)
        pen.multiline_text((CELL_GAP, top + CELL_GAP), label, TEXT_COLOR, font)
        for column, cell in enumerate(row.cells):
            left = LABEL_WIDTH + column * step
            sheet.paste(Image.fromarray(cell), (left, top))
            pen.rectangle((left - 1, top - 1, left + CELL_SIDE, top + CELL_SIDE), outline=(225, 225, 225))
    return sheet


def _cut_to_width(line: str, pen: ImageDraw.ImageDraw, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> str:
    """The line, cut to fit the label column."""
    if pen.textlength(line, font) <= LABEL_WIDTH - 2 * CELL_GAP:
        return line
    while line and pen.textlength(line + "...", font) > LABEL_WIDTH - 2 * CELL_GAP:
        line = line[:-1]
    return line + "..."


def _resize_to_cell(picture: np.ndarray) -> np.ndarray:
    """Image (H, W, 3) uint8 resized to the cell; small ones by nearest neighbour, so that their pixels stay visible."""
    if picture.shape[:2] == (CELL_SIDE, CELL_SIDE):
        return picture
    method = Image.Resampling.NEAREST if picture.shape[0] < CELL_SIDE else Image.Resampling.BOX
    return np.asarray(Image.fromarray(picture).resize((CELL_SIDE, CELL_SIDE), method))
