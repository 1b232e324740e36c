"""Contact sheets: many pictures on one page, each with its name below it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from z2p_renderer.pipeline.outputs.sheet_files import MARK, check_places, drop_later, sheet_path
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.images.png import png

CELL, LABEL, GAP = 320, 26, 8
"""Largest side of a picture on the sheet, height of its name, and the space between, pixels."""
SMALLEST = 96
"""Side that a name needs; smaller pictures stand in the middle of it."""
WIDEST = 8000
"""Pixels along a side of a sheet; with more columns or rows the pictures get smaller."""
PAPER, INK = (255, 255, 255), (60, 60, 60)


def write_contact_sheets(pictures: Sequence[Path], folder: Path, columns: int, rows: int) -> list[Path]:
    """``sheet.png`` in the folder, and ``sheet_2.png`` and on where there are more pictures than cells.

    Transparent pictures stand on white, none larger than it is. Sheets of an earlier run with more of them go.

    Raises:
        SettingError: in place of a sheet there is something else; see `check_places`.
    """
    check_places(folder, -(-len(pictures) // (columns * rows)))
    cell = min(CELL, max(SMALLEST, *map(_side, pictures)), WIDEST // columns - GAP, WIDEST // rows - GAP - LABEL)
    sheets: list[Path] = []
    for first in range(0, len(pictures), columns * rows):
        path = sheet_path(folder, len(sheets) + 1)
        page = _page(pictures[first : first + columns * rows], columns, cell)
        atomic_write(png(page, {MARK: path.name}), path)
        sheets.append(path)
    drop_later(folder, len(sheets))
    return sheets


def _side(picture: Path) -> int:
    """The longer side of a picture, pixels."""
    with Image.open(picture) as opened:
        return max(opened.size)


def _page(pictures: Sequence[Path], columns: int, cell: int) -> np.ndarray:
    """Sheet (H, W, 3) uint8 with as many rows as the pictures take."""
    rows, columns = -(-len(pictures) // columns), min(columns, len(pictures))
    step = (cell + GAP, cell + GAP + LABEL)
    page = Image.new("RGB", (columns * step[0] + GAP, rows * step[1] + GAP), PAPER)
    pen, font = ImageDraw.Draw(page), ImageFont.load_default(max(9, cell // 22))
    for index, path in enumerate(pictures):
        left, top = GAP + index % columns * step[0], GAP + index // columns * step[1]
        with Image.open(path) as picture:
            small = picture.convert("RGBA")
        small.thumbnail((cell, cell), Image.Resampling.LANCZOS)
        page.paste(small, (left + (cell - small.width) // 2, top + (cell - small.height) // 2), small)
        name = printable(Path(path.stem))
        while len(name) > 4 and pen.textlength(name, font) > cell:
            name = f"{name[:-4]}..."
        pen.text((left + cell // 2, top + cell + LABEL // 2), name, INK, font, anchor="mm")
    return np.asarray(page)
