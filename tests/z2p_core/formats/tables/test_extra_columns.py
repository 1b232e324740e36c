"""Columns without names: what they hold by their numbers, and what is left open."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.formats.tables.extra_columns import colors_hold, guess_columns

RNG = np.random.default_rng(1)
POINTS = RNG.normal(size=(200, 3))
BYTES = RNG.integers(0, 256, (200, 3)).astype(float)
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)


def names(*columns: np.ndarray) -> tuple[str, ...]:
    return guess_columns(np.column_stack(columns), POINTS).names


def test_colors_and_normals_are_found_wherever_they_stand() -> None:
    time = np.arange(200) / 7
    assert names(BYTES) == ("r", "g", "b")
    assert names(time, NORMALS, BYTES) == ("", "nx", "ny", "nz", "r", "g", "b")
    assert names(BYTES * 257) == ("r", "g", "b")


def test_four_columns_of_bytes_are_left_open() -> None:
    guess = guess_columns(RNG.integers(0, 256, (200, 4)).astype(float), POINTS)
    assert guess.names == ("",) * 4 and guess.doubtful == (0, 1, 2, 3)
    assert guess.note(4) == "no colours: which of columns 4 to 7 they are is not known"


@pytest.mark.parametrize("three", [
    RNG.integers(0, 12, (200, 3)), np.column_stack([BYTES[:, 0], RNG.integers(0, 9, (200, 2))]),
    RNG.dirichlet((1, 1, 1), 200), (POINTS + 9) / 20, np.sort(BYTES, axis=0), BYTES - 40, BYTES * 300,
    np.full((200, 3), 7.0),
], ids=["counts", "classes", "parts", "unit cube", "times", "negative", "too large", "constant"])  # fmt: skip
def test_other_columns_are_no_colors(three: np.ndarray) -> None:
    assert names(three.astype(float)) == ("", "", "")


def test_few_rows_tell_nothing() -> None:
    assert guess_columns(BYTES[:9], POINTS[:9]).names == ("", "", "")


def test_a_guess_holds_for_all_rows_or_falls() -> None:
    assert colors_hold(BYTES, POINTS)
    later = BYTES.copy()
    later[-1] = -1
    assert not colors_hold(later, POINTS)
