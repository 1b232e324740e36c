"""Points of a text file: xyz, xyzn, xyzrgb, pts and txt, with the columns that Open3D gives these suffixes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from z2p_core.interfaces import Reader, ScanError

_COLUMNS = {
    ".xyz": ((3,), "x y z"),
    ".xyzn": ((6,), "x y z nx ny nz"),
    ".xyzrgb": ((6,), "x y z r g b"),
    ".pts": ((3, 4, 6, 7), "x y z [intensity] [r g b]"),
}
_SIX_IN_XYZ = "; six columns in .xyz may be normals or colours: rename the file to .xyzn or .xyzrgb"


class Text(Reader):
    """Plain text, a point a line, numbers parted by blanks or commas; ``#`` begins a comment."""

    name = "text"
    version = "1"
    suffixes = (".xyz", ".xyzn", ".xyzrgb", ".pts", ".txt")

    def read(self, path: Path) -> list[np.ndarray]:
        """The first three columns, one cloud (N, 3) float64; a .txt may have any further columns.

        A .pts begins with the number of its points; a file that has lost that line is read all the same.

        Raises:
            ScanError: other columns than the suffix stands for, something not a number, or a wrong count in .pts.
        """
        suffix = path.suffix.lower()
        lines = _content(path.read_bytes())
        promised = lines.pop(0) if suffix == ".pts" and lines and len(lines[0].split()) == 1 else None
        table = _numbers(lines)
        _check_columns(suffix, table)
        if promised is not None and promised.strip() != str(len(table)):
            raise ScanError(f"the first line of the .pts file promises {promised.strip()[:40]!r} points, "
                            f"{len(table)} came; mend the number or export the file again")
        return [table[:, :3]]


def _content(blob: bytes) -> list[str]:
    """Lines that hold something, without comments, blanks between the numbers."""
    text = blob.decode("utf-8-sig", errors="replace").replace(",", " ")
    lines = (line.split("#", 1)[0] for line in text.splitlines()) if "#" in text else text.splitlines()
    return [line for line in lines if line and not line.isspace()]


def _numbers(lines: list[str]) -> np.ndarray:
    """Table (N, columns) float64."""
    if not lines:
        return np.empty((0, 3))
    try:
        return np.loadtxt(lines, dtype=np.float64, comments=None, ndmin=2)
    except ValueError as error:
        reason = str(error).split(";")[0]
        raise ScanError(f"expected the same count of numbers on every line: {reason} (lines with content, "
                        "counted from 0); put '#' before lines that are no points") from error


def _check_columns(suffix: str, table: np.ndarray) -> None:
    columns = table.shape[1]
    if len(table) == 0:
        return
    if suffix not in _COLUMNS:  # .txt
        if columns < 3:
            raise ScanError(f"expected x y z and perhaps more on a line, got {columns} columns")
        return
    allowed, meaning = _COLUMNS[suffix]
    if columns not in allowed:
        hint = _SIX_IN_XYZ if (suffix, columns) == (".xyz", 6) else "; rename it to .txt to use the first three"
        counts = " or ".join(str(count) for count in allowed)
        raise ScanError(f"a {suffix} file has {counts} columns ({meaning}), got {columns}{hint if columns > 3 else ''}")
