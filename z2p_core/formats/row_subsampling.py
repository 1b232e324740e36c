"""Rows of a cloud too large for memory: a few that stand for all, read in blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

MOST_ROWS = 4_000_000
"""Of larger clouds so many points are drawn, spread over the file: a hundred a pixel of an object at 512x512."""
BLOCK = 32_000_000
"""Bytes that are read at a time."""


def spread_points(
    read: Callable[[int], np.ndarray], count: int, row_bytes: int, rng: np.random.Generator, most: int
) -> np.ndarray:
    """At most `most` points (M, 3) float64 of a file of `count` rows, one at random of every so many in turn.

    `read` gives the next rows, as many as it is asked for, (n, 3) of any type; together they are the whole file, never
    more than about `BLOCK` bytes at a time. Every k-th would fall in step with a scanner's lines.
    """
    blocks = spread_rows(count, row_bytes, rng, most)
    return np.concatenate([read(rows)[kept].astype(np.float64) for rows, kept in blocks])


def spread_rows(count: int, row_bytes: int, rng: np.random.Generator, most: int) -> Iterator[tuple[int, np.ndarray]]:
    """Blocks of rows, one after the other: how many, and which of them (counted in the block) stand for the others."""
    step = -(-count // most)
    strides = max(1, BLOCK // (row_bytes * step))
    for first in range(0, count, strides * step):
        rows = min(strides * step, count - first)
        start = np.arange(0, rows, step)
        yield rows, start + (rng.random(len(start)) * np.minimum(step, rows - start)).astype(np.int64)
