"""Cropped batches: windows that hold the clouds, cut alike from all that belongs together."""

import numpy as np
import pytest
import torch

from z2p_renderer.pipeline.training.cropping import crop_batch
from z2p_renderer.pipeline.training.dataset import Batch

SIDE, CELL = 128, 4


def batch_of(boxes):
    """Samples whose z-buffer shows a box each, and whose every picture tells its pixels apart."""
    count = len(boxes)
    places = torch.arange(SIDE * SIDE, dtype=torch.float32).reshape(1, 1, SIDE, SIDE).expand(count, 1, -1, -1)
    drawn = torch.zeros(count, 1, SIDE, SIDE)
    for one, (top, bottom, left, right) in zip(drawn, boxes, strict=True):
        one[0, top, left] = one[0, bottom, right] = 1
    return Batch(torch.cat([drawn, places], 1), torch.zeros(count, 3), places.expand(-1, 4, -1, -1), places)


@pytest.mark.parametrize("seed", range(8))
def test_crops_contain_the_clouds_and_match_each_other(seed):
    boxes = [(40, 80, 10, 100), (0, 20, 50, 70), (60, 127, 64, 127)]
    batch = batch_of(boxes)
    rows, columns = (torch.arange(SIDE // CELL, dtype=torch.float32) * CELL for _ in range(2))
    encoding = torch.stack(torch.meshgrid(rows, columns, indexing="ij"))
    cut, parts = crop_batch(batch, encoding, 1, 32, CELL, np.random.default_rng(seed))
    height, width = cut.buffers.shape[2:]
    assert height % 32 == 0 and width % 32 == 0 and parts.shape == (3, 2, height // CELL, width // CELL)
    assert height == 96 and width == 128  # the last cloud's rows and the first's columns, with a margin
    assert torch.equal(cut.target[:, :1], cut.coverage) and torch.equal(cut.buffers[:, 1:], cut.coverage)
    assert torch.equal(cut.buffers[:, 0].sum(dim=(1, 2)), torch.full((3,), 2.0))
    for picture, part in zip(cut.coverage, parts, strict=True):
        top, left = divmod(int(picture[0, 0, 0]), SIDE)
        assert [top, left] == part[:, 0, 0].tolist()
        assert int(picture[0, -1, -1]) == (top + height - 1) * SIDE + left + width - 1


def test_crop_positions_vary():
    batch = batch_of([(60, 68, 60, 68), (40, 80, 40, 80)])
    corners = {
        float(
            crop_batch(batch, torch.zeros(0, 32, 32), 1, 32, CELL, np.random.default_rng(seed))[0].coverage[0, 0, 0, 0]
        )
        for seed in range(20)
    }
    assert len(corners) > 3


def test_batch_of_empty_clouds_is_cropped_to_the_minimum():
    batch = batch_of([(0, 0, 0, 0)])
    batch.buffers[:, 0] = 0
    cut, _ = crop_batch(batch, torch.zeros(0, 32, 32), 1, 32, CELL, np.random.default_rng(0))
    assert cut.buffers.shape[2:] == (32, 32)
