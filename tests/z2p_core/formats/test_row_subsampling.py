"""Points that stand for a cloud too large for memory: spread evenly, drawn from the whole file, in small blocks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from z2p_core.formats import row_subsampling
from z2p_core.formats.row_subsampling import subsample_blocks, subsample_points


@given(st.integers(1, 5000), st.integers(1, 400), st.integers(1, 200), st.integers(0, 9))
def test_one_row_of_each_stride_is_kept(count: int, most: int, row_bytes: int, seed: int) -> None:
    blocks = list(subsample_blocks(count, row_bytes, np.random.default_rng(seed), most))
    assert sum(rows for rows, _ in blocks) == count
    ends = np.cumsum([0, *(rows for rows, _ in blocks)])
    rows = np.concatenate([first + kept for first, (_, kept) in zip(ends, blocks, strict=False)])
    step = max(count / most, 1.0)
    assert len(rows) == min(count, most)
    assert np.abs(rows - (np.arange(len(rows)) + 0.5) * step).max() <= 2 * step + 1
    assert (np.diff(rows) > 0).all()


def test_blocks_are_small_and_cover_the_whole_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(row_subsampling, "BLOCK_BYTES", 1200)
    table = np.random.default_rng(0).normal(size=(5003, 3)).astype(np.float32)
    asked: list[int] = []

    def read(rows: int) -> np.ndarray:
        asked.append(rows)
        return table[sum(asked) - rows : sum(asked)]

    points = subsample_points(read, len(table), 12, np.random.default_rng(1), 500)
    assert sum(asked) == len(table) and max(asked) <= 110 and max(asked) * 12 <= 1200
    assert points.dtype == np.float64 and points.shape == (500, 3)
    known = {row.tobytes() for row in table}
    assert all(row.astype(np.float32).tobytes() in known for row in points)


def test_subsampling_does_not_alias_with_scan_lines() -> None:
    """Every tenth of lines of 100 points would see ten columns alone."""
    columns = np.concatenate([kept for _, kept in subsample_blocks(100_000, 1, np.random.default_rng(0), 10_000)]) % 100
    assert np.bincount(columns, minlength=100).min() > 50
