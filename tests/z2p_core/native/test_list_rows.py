"""Rows that contain lists are read in either byte order, and never past the end of the file."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.native import read_list_rows

KINDS = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")


def random_rows(order: str, rows: int, rng: np.random.Generator) -> tuple[bytes, list, list[int], np.ndarray]:
    """Bytes of rows of numbers and lists of random types, their properties, the wanted ones, and their values."""
    properties = []
    for _ in range(rng.integers(1, 6)):
        kind, length = (np.dtype(order + str(rng.choice(part))) for part in (KINDS, KINDS[:8]))
        properties.append((kind, length if rng.random() < 0.5 else None))
    properties.append((np.dtype(order + "f4"), None))
    wanted = [index for index, (_, length) in enumerate(properties) if length is None][::-1]
    blob, values = b"", np.zeros((rows, len(wanted)))
    for row in range(rows):
        for index, (kind, length) in enumerate(properties):
            if length is not None:
                count = int(rng.integers(0, 4))
                blob += np.array([count], length).tobytes() + rng.integers(0, 100, count).astype(kind).tobytes()
            else:
                number = np.array([rng.integers(0, 100)]).astype(kind)
                values[row, wanted.index(index)] = number[0]
                blob += number.tobytes()
    return blob, properties, wanted, values


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("seed", range(8))
def test_rows_of_numbers_and_lists_are_read(order: str, seed: int) -> None:
    blob, properties, wanted, expected = random_rows(order, 7, np.random.default_rng(seed))
    values, end = read_list_rows(b"abc" + blob + b"more", 3, 7, properties, wanted)
    assert np.array_equal(values, expected) and end == 3 + len(blob)
    for cut in range(0, len(blob), 3):
        with pytest.raises(ValueError, match=r"past the end|at least begin"):
            read_list_rows(b"abc" + blob[:cut], 3, 7, properties, wanted)


@pytest.mark.parametrize("length", KINDS[:8])
def test_lists_of_impossible_length_are_refused(length: str) -> None:
    kind = np.dtype(f"<{length}")
    numbers = [np.iinfo(kind).max] + ([-1, np.iinfo(kind).min] if kind.kind == "i" else [])
    for number in numbers:
        blob = np.array([number], kind).tobytes() + bytes(20)
        with pytest.raises(ValueError, match="past the end"):
            read_list_rows(blob, 0, 1, [(np.dtype("<f8"), kind)], [])


def test_impossible_row_counts_allocate_no_memory() -> None:
    with pytest.raises(ValueError, match="at least begin"):
        read_list_rows(bytes(100), 0, 10**15, [(np.dtype("<f4"), None)], [0])
    assert read_list_rows(bytes(100), 5, 10**15, [], [])[1] == 5  # rows without properties have no bytes
