"""Subsamples the rows of a cloud that is too large for memory, reading it in blocks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

MAX_ROWS = 4_000_000
"""Larger clouds are subsampled to at most this many points, where nothing is known of the picture."""
ROWS_PER_PIXEL = 8
"""Points for each pixel of a picture: half of them are hidden, and the object covers half of the picture."""
MIN_ROWS_LIMIT, MAX_ROWS_LIMIT = MAX_ROWS, 5_000_000
"""Smallest and largest number of points that a picture asks for, whatever its size: the largest takes about 1 GB."""
MAX_EXCESS = 1.2
"""Rows of a file of unknown length that may be kept, over those that are wanted, before they are thinned out."""
BLOCK_BYTES = 32_000_000
"""Approximate number of bytes that are read at a time."""


def rows_for_picture(width: int, height: int) -> int:
    """How many points of a file a picture of that size in pixels can show."""
    return min(max(ROWS_PER_PIXEL * width * height, MIN_ROWS_LIMIT), MAX_ROWS_LIMIT)


def stratified_rows(count: int, step: float, rng: np.random.Generator) -> np.ndarray:
    """Sorted indices (M,) int64 of a random one of each `step` consecutive rows of `count`; M = ceil(count / step).

    The step is at least 1 and need not be whole. Taking every k-th row instead would alias with a scanner's lines.
    """
    kept = math.ceil(count / step - 1e-9)
    edges = np.minimum((np.arange(kept + 1) * step).astype(np.int64), count)
    return edges[:-1] + (rng.random(kept) * np.diff(edges)).astype(np.int64)


def subsample_points(
    read: Callable[[int], np.ndarray], count: int, row_bytes: int, rng: np.random.Generator, max_points: int
) -> np.ndarray:
    """Stratified random subsample: one point of each count / max_points consecutive rows.

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
    share = min(max_points / count, 1.0) if count else 1.0
    size = max(BLOCK_BYTES // row_bytes, math.ceil(1 / share))
    for first in range(0, count, size):
        rows = min(size, count - first)
        kept = math.floor((first + rows) * share + 1e-6) - math.floor(first * share + 1e-6)
        yield rows, stratified_rows(rows, rows / max(kept, 1), rng)[:kept]


class ThinnedRows:
    """Collects the rows of a file whose number of rows is not known before its end: at most `max_rows`, evenly."""

    def __init__(self, columns: int, max_rows: int, expected_rows: float) -> None:
        """`columns` of the table; `expected_rows` may be an estimate, which saves thinning out again."""
        self._parts: list[np.ndarray] = [np.empty((0, columns))]
        self._max_rows = max_rows
        self._step = max(expected_rows / max_rows, 1.0)
        self._kept = 0
        self._rng = np.random.default_rng(0)

    def add(self, rows: np.ndarray) -> None:
        """Takes the next rows (N, columns), of which a random one of each step is kept."""
        chosen = self.choose(len(rows))
        self.keep(rows if chosen is None else rows[chosen])

    def choose(self, count: int) -> np.ndarray | None:
        """Indices of those of the next `count` rows that are to be kept, so that others need not be parsed; None: all.

        The caller hands them to `keep`.
        """
        return stratified_rows(count, self._step, self._rng) if self._step > 1 else None

    def keep(self, rows: np.ndarray) -> None:
        """Takes rows (N, columns) that `choose` has chosen."""
        self._parts.append(rows)
        self._kept += len(rows)
        while self._kept > MAX_EXCESS * self._max_rows:
            self._step *= 2
            table = self.table()
            self._parts = [table[stratified_rows(len(table), 2.0, self._rng)]]
            self._kept = len(self._parts[0])

    @property
    def is_thinned(self) -> bool:
        """Whether some of the rows are left out."""
        return self._step > 1

    def table(self) -> np.ndarray:
        """All rows (M, columns) that are kept."""
        return np.concatenate(self._parts)
