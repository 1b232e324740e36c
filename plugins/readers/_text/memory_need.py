"""Estimates how much memory a text of points needs, from its first lines."""

from __future__ import annotations

from pathlib import Path

from z2p_core.interfaces import MEMORY_A_BYTE, MEMORY_A_POINT

_SAMPLE_BYTES = 1 << 16
"""Bytes from which the length of a line is estimated."""


def estimate_lines(path: Path) -> int:
    """About how many lines a text has, by the length of its first ones."""
    with path.open("rb") as file:
        head = file.read(_SAMPLE_BYTES)
    return path.stat().st_size * max(head.count(b"\n"), 1) // max(len(head), 1)


def memory_of_lines(path: Path, max_rows: int) -> int:
    """Upper bound, in bytes, of the memory for a text with one point per line, which is read in blocks.

    Of more than `max_rows` lines about so many are kept.
    """
    with path.open("rb") as file:
        head = file.read(_SAMPLE_BYTES)
    if head.lstrip()[:5].lower() in (b"ncols", b"nrows"):  # a raster, each number of which is a point
        return path.stat().st_size * len(head.split()) // len(head) * MEMORY_A_POINT
    lines = head.count(b"\n")
    if lines < 2:  # one endless line would be in memory as a whole
        return MEMORY_A_BYTE * path.stat().st_size
    return min(path.stat().st_size * lines // len(head), 2 * max_rows) * MEMORY_A_POINT
