"""Points of an ESRI ASCII grid: header lines with its position, then heights row by row from north to south."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

import numpy as np

from z2p_core.interfaces import ScanError

_HEADER_KEYS = {"ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "nodata_value",
                "dx", "dy", "xdim", "ydim"}  # fmt: skip
_MAX_HEADER_LINES = 12
"""No grid has more lines before its heights."""


def is_esri_grid(lines: list[str]) -> bool:
    """Whether the first lines of a file are those of an ESRI ASCII grid."""
    return bool(lines) and lines[0].split()[0].lower() in ("ncols", "nrows")


def read_esri_grid(first: list[str], blocks: Iterable[list[str]]) -> np.ndarray:
    """Points (N, 3) float64 at the centers of the cells that have a height, from all lines of a file.

    Raises:
        ScanError: the header is incomplete, or the number of heights differs from its columns times rows.
    """
    keys, used = _parse_header(first)
    columns, rows, left, bottom, cell_width, cell_height = _cell_layout(keys)
    try:
        parts = [np.array(" ".join(lines).replace(",", ".").split(), dtype=np.float64)
                 for lines in chain([first[used:]], blocks)]
    except ValueError as error:
        raise ScanError(f"the ESRI grid's heights cannot be read ({str(error)[:120]}); export it again") from error
    heights = np.concatenate(parts)
    if len(heights) != columns * rows:
        raise ScanError(f"the ESRI grid promises {columns} x {rows} heights, {len(heights)} came; export it again")
    measured = np.flatnonzero(np.isfinite(heights) & (heights != keys.get("nodata_value", -9999.0)))
    row, column = np.divmod(measured, columns)
    return np.column_stack([left + column * cell_width, bottom + (rows - 1 - row) * cell_height, heights[measured]])


def _parse_header(lines: list[str]) -> tuple[dict[str, float], int]:
    """The values of the header lines by key, and the number of these lines."""
    keys: dict[str, float] = {}
    for index, line in enumerate(lines[:_MAX_HEADER_LINES]):
        words = line.replace(",", ".").lower().split()
        if words[0] not in _HEADER_KEYS:
            return keys, index
        try:
            (keys[words[0]],) = map(float, words[1:])
        except ValueError as error:
            raise ScanError(f"the ESRI grid's {words[0]} is {line.strip()[:40]!r}, expected one number; export the "
                            "grid again") from error
    return keys, min(len(lines), _MAX_HEADER_LINES)


def _cell_layout(keys: dict[str, float]) -> tuple[int, int, float, float, float, float]:
    """Columns, rows, x and y of the center of the lower left cell, and the width and height of a cell."""
    cell_width = keys.get("cellsize", keys.get("dx", keys.get("xdim", 1.0)))
    cell_height = keys.get("cellsize", keys.get("dy", keys.get("ydim", cell_width)))
    columns, rows = keys.get("ncols", 0.0), keys.get("nrows", 0.0)
    valid_counts = 1 <= columns < 1e9 and 1 <= rows < 1e9 and columns % 1 == rows % 1 == 0
    if not valid_counts or not (cell_width > 0 and cell_height > 0):
        raise ScanError("expected an ESRI grid's ncols, nrows and cellsize as numbers above 0, got "
                        f"{', '.join(f'{key} {value:g}' for key, value in keys.items())}; export the grid again")
    left = keys.get("xllcenter", keys.get("xllcorner", 0.0) + cell_width / 2)
    bottom = keys.get("yllcenter", keys.get("yllcorner", 0.0) + cell_height / 2)
    return int(columns), int(rows), left, bottom, cell_width, cell_height
