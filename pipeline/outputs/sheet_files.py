"""Files of contact sheets: what they are called, what tells one from other pictures, and which may be replaced."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from z2p_core.interfaces import SettingError
from z2p_renderer.storage.files.printable_names import printable

SHEET_KEYWORD = "z2p-sheet"
"""Keyword of the text inside that tells a sheet from all other pictures, which are nobody's to replace."""


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
