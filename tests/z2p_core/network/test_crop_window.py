"""Crops contain the mask and a margin, and no more of the image than the network's stride requires."""

import numpy as np
import pytest

from z2p_core.network.crop_window import CROP_MARGIN, crop_window

STRIDE, CELL = 32, 4


def shown_in(shape, rows, columns):
    shown = np.zeros(shape, bool)
    shown[rows[0], columns[0]] = shown[rows[1], columns[1]] = True
    return shown


@pytest.mark.parametrize("shape", [(512, 512), (256, 384), (250, 333), (61, 97), (33, 40)])
def test_crop_contains_the_mask_and_a_margin(shape):
    rng, (height, width) = np.random.default_rng(0), shape
    for _ in range(50):
        rows, columns = np.sort(rng.integers(0, height, 2)), np.sort(rng.integers(0, width, 2))
        window = crop_window(shown_in(shape, rows, columns), STRIDE, CELL)
        for side, (first, last), size in zip(window, (rows, columns), shape, strict=True):
            assert 0 <= side.start <= max(first - CROP_MARGIN, 0)
            assert min(last + 1 + CROP_MARGIN, size) <= side.stop <= size
            assert side.start % CELL == 0
            length = side.stop - side.start
            assert length % STRIDE == 0 or side.stop == size
            assert length < last + 1 - first + 2 * CROP_MARGIN + STRIDE + CELL


def test_crop_of_an_empty_mask_is_the_smallest():
    assert crop_window(np.zeros((100, 200), bool), STRIDE, CELL) == (slice(0, STRIDE), slice(0, STRIDE))
