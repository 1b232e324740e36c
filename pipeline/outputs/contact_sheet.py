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
"""Keyword of a text in the PNG file, by which a contact sheet is known; no other pictures may be replaced."""
MAX_CELL_SIDE = 320
"""Largest side of a picture on the sheet, pixels."""
MIN_CELL_SIDE = 96
"""Space for a name, pixels; smaller pictures stand in the middle of their cell."""
LABEL_HEIGHT = 26
"""Height of the name below each picture, pixels."""
GAP = 8
"""Space between cells, pixels."""
MAX_SHEET_SIDE = 8000
"""Largest side of a sheet, pixels; many columns or rows make the pictures smaller."""
PAPER_COLOR = (255, 255, 255)
INK_COLOR = (60, 60, 60)


def write_contact_sheets(pictures: Sequence[Path], folder: Path, columns: int, rows: int) -> list[Path]:
    """Writes ``sheet.png`` into the folder, and ``sheet_2.png`` and so on if there are more pictures than cells.

    Pictures are composited over white and not enlarged. Surplus sheets of an earlier, longer run are removed.

    Returns:
        The paths of the sheets.

    Raises:
        SettingError: another file is in the place of a sheet; see `check_sheet_places`.
    """
    check_sheet_places(folder, -(-len(pictures) // (columns * rows)))
    wanted = min(MAX_CELL_SIDE, max(MIN_CELL_SIDE, *map(_longer_side, pictures)))
    cell = min(wanted, MAX_SHEET_SIDE // columns - GAP, MAX_SHEET_SIDE // rows - GAP - LABEL_HEIGHT)
    sheets: list[Path] = []
    for first in range(0, len(pictures), columns * rows):
        path = sheet_path(folder, len(sheets) + 1)
        page = _draw_sheet(pictures[first : first + columns * rows], columns, cell)
        atomic_write(encode_png(page, {SHEET_KEYWORD: path.name}), path)
        sheets.append(path)
    remove_surplus_sheets(folder, len(sheets))
    return sheets


def sheet_path(folder: Path, number: int) -> Path:
    """Path of the sheet of a number; the first has number 1."""
    return folder / ("sheet.png" if number == 1 else f"sheet_{number}.png")


def check_sheet_places(folder: Path, count: int = 1) -> None:
    """Makes sure that `count` contact sheets in a folder would replace nothing but contact sheets.

    Raises:
        SettingError: another file has the name of a sheet.
    """
    for number in range(1, count + 1):
        path = sheet_path(folder, number)
        if path.exists() and not is_sheet(path):
            raise SettingError(f"{printable(path)} is there already, and is no contact sheet of this z2p: rename it, "
                               "or choose another folder")


def remove_surplus_sheets(folder: Path, count: int) -> None:
    """Removes the sheets after the first `count`, which an earlier, longer run left; other files stay."""
    for number in range(count + 1, 1000):
        if not is_sheet(surplus := sheet_path(folder, number)):
            break
        surplus.unlink()


def is_sheet(path: Path) -> bool:
    """Whether a file is a contact sheet that z2p wrote."""
    try:
        with Image.open(path) as page:
            return SHEET_KEYWORD in page.info
    except (OSError, SyntaxError, ValueError):  # not a picture
        return False


def _longer_side(picture: Path) -> int:
    """The longer side of a picture, pixels."""
    with Image.open(picture) as opened:
        return max(opened.size)


def _draw_sheet(pictures: Sequence[Path], columns: int, cell: int) -> np.ndarray:
    """The sheet (H, W, 3) uint8, with as many rows as the pictures need; `cell` is the side of a cell, pixels."""
    rows, columns = -(-len(pictures) // columns), min(columns, len(pictures))
    step_x, step_y = cell + GAP, cell + GAP + LABEL_HEIGHT
    page = Image.new("RGB", (columns * step_x + GAP, rows * step_y + GAP), PAPER_COLOR)
    canvas, font = ImageDraw.Draw(page), ImageFont.load_default(max(9, cell // 22))
    for index, path in enumerate(pictures):
        left, top = GAP + index % columns * step_x, GAP + index // columns * step_y
        with Image.open(path) as picture:
            thumbnail = picture.convert("RGBA")
        thumbnail.thumbnail((cell, cell), Image.Resampling.LANCZOS)
        page.paste(thumbnail, (left + (cell - thumbnail.width) // 2, top + (cell - thumbnail.height) // 2), thumbnail)
        name = printable(Path(path.stem))
        while len(name) > 4 and canvas.textlength(name, font) > cell:
            name = f"{name[:-4]}..."
        canvas.text((left + cell // 2, top + cell + LABEL_HEIGHT // 2), name, INK_COLOR, font, anchor="mm")
    return np.asarray(page)
