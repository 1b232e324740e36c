"""The window of a picture that a network has to draw: where the cloud is, and some pixels around it."""

from __future__ import annotations

import numpy as np

CROP_MARGIN = 12
"""Pixels around the cloud, in which the network may smooth its outline and what lies in contact with the floor."""


def crop_window(shown: np.ndarray, stride: int, cell: int, margin: int = CROP_MARGIN) -> tuple[slice, slice]:
    """Rows and columns of the window around what is shown (H, W) bool.

    Sides are multiples of the network's stride and begin at whole cells of it, so that nothing is padded, but where
    that would reach beyond the picture. A window around nothing is the smallest there is.
    """
    rows, columns = (_place_crop(padded_extent(shown.any(axis), margin), stride, cell, shown.shape[1 - axis]) for axis in (1, 0))
    return rows, columns


def padded_extent(lines: np.ndarray, margin: int) -> tuple[int, int]:
    """First of the lines (L,) bool that show something and the one after the last, with a margin; (0, 0) of none."""
    found = np.flatnonzero(lines)
    if not len(found):
        return 0, 0
    return max(int(found[0]) - margin, 0), min(int(found[-1]) + 1 + margin, len(lines))


def crop_side(wanted: int, stride: int, size: int) -> int:
    """Side of a window that holds so many pixels, at most all of them."""
    return min(max(-(-wanted // stride), 1) * stride, size)


def _place_crop(ends: tuple[int, int], stride: int, cell: int, size: int) -> slice:
    """The window's side of a picture of that size around the ends of what it shows."""
    first = ends[0] // cell * cell
    length = crop_side(ends[1] - first, stride, size)
    begin = min(first, -(-(size - length) // cell) * cell)
    return slice(begin, min(begin + length, size))
