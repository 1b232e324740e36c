"""Subsamples the rows of a cloud that is too large for memory, reading it in blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

MAX_ROWS = 4_000_000
"""Larger clouds are subsampled to at most this many points: about a hundred per pixel of an object at 512x512."""
BLOCK_BYTES = 32_000_000
"""Approximate number of bytes that are read at a time."""


def subsample_points(
    read: Callable[[int], np.ndarray], count: int, row_bytes: int, rng: np.random.Generator, max_points: int
) -> np.ndarray:
    """Stratified random subsample: one point of each run of k = ceil(count / max_points) consecutive rows.

    Taking every k-th row instead would alias with the lines of a scanner.

    Args:
        read: returns the next n rows of the file, (n, 3) of any type; the calls cover the whole file in order, with
            about `BLOCK_BYTES` bytes each.
        count: rows of the file.
        row_bytes: size of a row.
        rng: random generator.
        max_points: upper limit of the number of points.

    Returns:
        Points (M, 3) float64, M <= max_points.
    """
    blocks = subsample_blocks(count, row_bytes, rng, max_points)
    return np.concatenate([read(rows)[kept].astype(np.float64) for rows, kept in blocks])


def subsample_blocks(
    count: int, row_bytes: int, rng: np.random.Generator, max_points: int
) -> Iterator[tuple[int, np.ndarray]]:
    """The successive blocks of a file: the number of rows, and the indices within the block of the rows to keep."""
    step = -(-count // max_points)
    strides = max(1, BLOCK_BYTES // (row_bytes * step))
    for first in range(0, count, strides * step):
        rows = min(strides * step, count - first)
        start = np.arange(0, rows, step)
        yield rows, start + (rng.random(len(start)) * np.minimum(step, rows - start)).astype(np.int64)
