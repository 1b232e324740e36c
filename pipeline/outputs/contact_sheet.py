"""Contact sheets: many pictures on one page, each with its name below it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from z2p_core.interfaces import SettingError
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.images.png import encode_png

SHEET_KEYWORD = "z2p-sheet"
"""Keyword of the text inside that tells a sheet from all other pictures, which are nobody's to replace."""
MAX_CELL_SIDE, LABEL_HEIGHT, GAP = 320, 26, 8
"""Largest side of a picture on the sheet, height of its name, and the space between, pixels."""
MIN_CELL_SIDE = 96
"""Side that a name needs; smaller pictures stand in the middle of it."""
MAX_SHEET_SIDE = 8000
"""Pixels along a side of a sheet; with more columns or rows the pictures get smaller."""
PAPER_COLOR, INK_COLOR = (255, 255, 255), (60, 60, 60)


def write_contact_sheets(pictures: Sequence[Path], folder: Path, columns: int, rows: int) -> list[Path]:
    """``sheet.png`` in the folder, and ``sheet_2.png`` and on where there are more pictures than cells.

    Transparent pictures stand on white, none larger than it is. Sheets of an earlier run with more of them go.

    Raises:
        SettingError: in place of a sheet there is something else; see `check_sheet_places`.
    """
    check_sheet_places(folder, -(-len(pictures) // (columns * rows)))
    cell = min(MAX_CELL_SIDE, max(MIN_CELL_SIDE, *map(_longer_side, pictures)), MAX_SHEET_SIDE // columns - GAP, MAX_SHEET_SIDE // rows - GAP - LABEL_HEIGHT)
    sheets: list[Path] = []
    for first in range(0, len(pictures), columns * rows):
        path = sheet_path(folder, len(sheets) + 1)
        page = _draw_sheet(pictures[first : first + columns * rows], columns, cell)
        atomic_write(encode_png(page, {SHEET_KEYWORD: path.name}), path)
        sheets.append(path)
    remove_surplus_sheets(folder, len(sheets))
    return sheets


def sheet_path(folder: Path, number: int) -> Path:
    """Where the sheet of a number, from 1 on, lies."""
    return folder / ("sheet.png" if number == 1 else f"sheet_{number}.png")


def check_sheet_places(folder: Path, count: int = 1) -> None:
    """Makes sure that so many sheets in a folder replace nothing but sheets.

    Raises:
        SettingError: a file of that name is something else.
    """
    for number in range(1, count + 1):
        path = sheet_path(folder, number)
        if path.exists() and not is_sheet(path):
            raise SettingError(f"{printable(path)} is there already, and no contact sheet of this z2p: rename it, or "
                               "choose another folder")


def remove_surplus_sheets(folder: Path, count: int) -> None:
    """Removes the sheets of a longer run into the same folder, those behind so many; other files stay."""
    for number in range(count + 1, 1000):
        if not is_sheet(left := sheet_path(folder, number)):
            break
        left.unlink()


def is_sheet(path: Path) -> bool:
    """Whether a file is a contact sheet that z2p wrote."""
    try:
        with Image.open(path) as page:
            return SHEET_KEYWORD in page.info
    except (OSError, SyntaxError, ValueError):  # no picture at all
        return False


def _longer_side(picture: Path) -> int:
    """The longer side of a picture, pixels."""
    with Image.open(picture) as opened:
        return max(opened.size)


def _draw_sheet(pictures: Sequence[Path], columns: int, cell: int) -> np.ndarray:
    """Sheet (H, W, 3) uint8 with as many rows as the pictures take."""
    rows, columns = -(-len(pictures) // columns), min(columns, len(pictures))
    step = (cell + GAP, cell + GAP + LABEL_HEIGHT)
    page = Image.new("RGB", (columns * step[0] + GAP, rows * step[1] + GAP), PAPER_COLOR)
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
        pen.text((left + cell // 2, top + cell + LABEL_HEIGHT // 2), name, INK_COLOR, font, anchor="mm")
    return np.asarray(page)
