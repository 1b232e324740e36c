"""The crop of an image that the network has to draw: the cloud, and a margin around it."""

from __future__ import annotations

import numpy as np

CROP_MARGIN = 12
"""Pixels around the cloud, in which the network may smooth its outline and its contact with the floor."""


def crop_window(mask: np.ndarray, stride: int, cell: int, margin: int = CROP_MARGIN) -> tuple[slice, slice]:
    """Rows and columns of the crop around the pixels that a mask (H, W) bool holds.

    Sides are multiples of the network's `stride`, so that nothing has to be padded, and start at multiples of `cell`,
    the side of its pixel blocks; both except where the crop would exceed the image. An empty mask gives the smallest
    crop, at the upper left.
    """
    rows, columns = (
        _place_crop(padded_extent(mask.any(axis), margin), stride, cell, mask.shape[1 - axis]) for axis in (1, 0)
    )
    return rows, columns


def padded_extent(lines: np.ndarray, margin: int) -> tuple[int, int]:
    """Range [first, last) of the lines (L,) bool that are true, grown by a margin within [0, L); (0, 0) for none."""
    true_lines = np.flatnonzero(lines)
    if not len(true_lines):
        return 0, 0
    return max(int(true_lines[0]) - margin, 0), min(int(true_lines[-1]) + 1 + margin, len(lines))


def crop_side(pixels: int, stride: int, size: int) -> int:
    """Smallest multiple of the stride that holds so many pixels, at least one stride, at most the image's `size`."""
    return min(max(-(-pixels // stride), 1) * stride, size)


def _place_crop(extent: tuple[int, int], stride: int, cell: int, size: int) -> slice:
    """Side of the crop that holds the extent [first, last), within an image side of that size."""
    first = extent[0] // cell * cell
    length = crop_side(extent[1] - first, stride, size)
    begin = min(first, -(-(size - length) // cell) * cell)
    return slice(begin, min(begin + length, size))
