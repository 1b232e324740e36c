"""Training batches cut to windows around their clouds, as pictures are before a network draws them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from z2p_core.network.crop_window import CROP_MARGIN, padded_extent, crop_side
from z2p_renderer.pipeline.training.dataset import Batch

MARGIN_RANGE = (CROP_MARGIN // 2, 2 * CROP_MARGIN)
"""Pixels around the clouds of a batch at least and below: not always the same, so that no border is learnt by heart."""


def crop_batch(
    batch: Batch, encoding: torch.Tensor, channels: int, stride: int, cell: int, rng: np.random.Generator
) -> tuple[Batch, torch.Tensor]:
    """The batch with windows (h, w) of its pictures, all of one size, each somewhere about its cloud.

    Also their part (B, E, h / cell, w / cell) of the encoding (E, R / cell, R / cell). The z-buffer's first so many
    channels tell where a cloud is. Sides are multiples of the network's stride, and begin at whole cells of it.
    """
    margin = int(rng.integers(*MARGIN_RANGE))
    shown = (batch.buffers[:, :channels] != 0).any(dim=1)  # (B, R, R)
    size = shown.shape[-1]
    begins, lengths = [], []
    for across in (2, 1):
        ends = [padded_extent(lines, margin) for lines in shown.any(dim=across).cpu().numpy()]
        length = crop_side(max(last - first // cell * cell for first, last in ends), stride, size)
        lengths.append(length)
        begins.append([_random_start(first, last, length, size, cell, rng) for first, last in ends])
    places = list(zip(*begins, strict=True))

    def cut(pictures: torch.Tensor, side: int = 1) -> torch.Tensor:
        height, width = (-(-length // side) for length in lengths)
        rows = [(one, top // side, left // side) for one, (top, left) in zip(pictures, places, strict=True)]
        return torch.stack([one[:, top : top + height, left : left + width] for one, top, left in rows])

    parts = {name: cut(getattr(batch, name)) for name in ("buffers", "target", "coverage")}
    return replace(batch, **parts), cut(encoding.expand(len(places), *encoding.shape), cell)


def _random_start(first: int, last: int, length: int, size: int, cell: int, rng: np.random.Generator) -> int:
    """Where a window of that length begins that holds a cloud's ends: at a whole cell."""
    lowest = max(-(-(last - length) // cell), 0)
    highest = min(first, size - length) // cell
    return cell * int(rng.integers(lowest, max(highest, lowest) + 1))
