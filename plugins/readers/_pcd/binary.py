"""Rows of a binary PCD file, row by row or packed field by field, a subsample of very many; read in blocks."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from z2p_core.formats.row_subsampling import subsample_blocks
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily

_SIZES = struct.Struct("<II")
"""Sizes in bytes of the packed and of the unpacked data, before the packed data."""


def row_dtype(names: Sequence[str], kinds: Sequence[str], counts: Sequence[int]) -> np.dtype:
    """The type of a row: of each field its name, its little-endian type such as ``f4``, and its count of numbers."""
    fields = [(name, f"<{kind}", (count,) if count > 1 else ()) for name, kind, count in
              zip(names, kinds, counts, strict=True)]  # fmt: skip
    return np.dtype(fields)


def read_rows(
    path: Path, start: int, row: np.dtype, count: int, wanted: Sequence[str], rng: np.random.Generator, max_rows: int
) -> dict[str, np.ndarray]:
    """The wanted fields (M,) or (M, C), M <= max_rows, of `count` rows from byte `start` on."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in wanted}
    with path.open("rb") as file:
        file.seek(start)
        for rows, kept in subsample_blocks(count, row.itemsize, rng, max_rows):
            block = np.frombuffer(file.read(rows * row.itemsize), row)
            chosen = slice(None) if len(kept) == rows else kept
            for name, part in parts.items():
                part.append(np.array(block[name][chosen]))
    return {name: np.concatenate(part) for name, part in parts.items()}


def read_packed(
    path: Path, start: int, row: np.dtype, count: int, wanted: Sequence[str], rng: np.random.Generator, max_rows: int
) -> dict[str, np.ndarray]:
    """The same of LZF-packed fields, one whole field after the other, as PCL's ``binary_compressed`` has them.

    Raises:
        ValueError: what is unpacked has another size than the rows.
    """
    unpacked = _unpack(path, start)
    if len(unpacked) != count * row.itemsize:
        raise ValueError(f"{count * row.itemsize} bytes expected, {len(unpacked)} came")
    blocks = list(subsample_blocks(count, row.itemsize, rng, max_rows))
    firsts = np.cumsum([0, *(rows for rows, _ in blocks)])
    kept = np.concatenate([first + rows for first, (_, rows) in zip(firsts, blocks, strict=False)])
    columns = {}
    assert row.fields is not None
    for name in wanted:
        kind, offset = row.fields[name][:2]
        column = np.frombuffer(unpacked, kind.base, count * (kind.itemsize // kind.base.itemsize), offset * count)
        column = column.reshape(count, *kind.shape)
        columns[name] = column.copy() if len(kept) == count else column[kept]
    return columns


def _unpack(path: Path, start: int) -> bytes:
    """The unpacked bytes of the packed ones whose two sizes stand at byte `start` of a file."""
    library = import_lazily("lzf")
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        packed, size = _SIZES.unpack_from(content, start)
        first = start + _SIZES.size
        unpacked: bytes | None = library.decompress(content[first : first + packed], size)
    return unpacked or b""


def stack_float64(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Columns (N,) beside each other, (N, C) float64, without a copy in between."""
    table = np.empty((len(columns[0]), len(columns)))
    for index, column in enumerate(columns):
        table[:, index] = column
    return table
