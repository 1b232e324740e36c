"""Random crops of training batches around their clouds, as inference crops an image before it runs the network."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from z2p_core.network.crop_window import CROP_MARGIN, crop_side, padded_extent
from z2p_renderer.pipeline.training.dataset import Batch

MARGIN_RANGE = (CROP_MARGIN // 2, 2 * CROP_MARGIN)
"""Range of the margin around a batch's clouds, pixels [low, high): it varies so that the network learns no border."""


def crop_batch(
    batch: Batch, encoding: torch.Tensor, channels: int, stride: int, cell: int, rng: np.random.Generator
) -> tuple[Batch, torch.Tensor]:
    """The batch cropped to (h, w) at a random place around each cloud, and the encoding cropped likewise.

    The encoding (E, R / cell, R / cell) becomes (B, E, h / cell, w / cell). The cloud lies where one of the first
    `channels` buffers, the z-buffer's, is not 0. h and w are multiples of the network's `stride`, and each crop starts
    at a multiple of `cell`, the side of the network's pixel blocks.
    """
    margin = int(rng.integers(*MARGIN_RANGE))
    has_points = (batch.buffers[:, :channels] != 0).any(dim=1)  # (B, R, R)
    size = has_points.shape[-1]
    starts, lengths = [], []
    for axis in (2, 1):
        ends = [padded_extent(lines, margin) for lines in has_points.any(dim=axis).cpu().numpy()]
        length = crop_side(max(last - first // cell * cell for first, last in ends), stride, size)
        lengths.append(length)
        starts.append([_random_start(first, last, length, size, cell, rng) for first, last in ends])
    corners = list(zip(*starts, strict=True))

    def crop(images: torch.Tensor, side: int = 1) -> torch.Tensor:
        height, width = (-(-length // side) for length in lengths)
        rows = [(one, top // side, left // side) for one, (top, left) in zip(images, corners, strict=True)]
        return torch.stack([one[:, top : top + height, left : left + width] for one, top, left in rows])

    images = [name for name in ("buffers", "target", "coverage", "factors") if getattr(batch, name) is not None]
    cropped = {name: crop(getattr(batch, name)) for name in images}
    return replace(batch, **cropped), crop(encoding.expand(len(corners), *encoding.shape), cell)


def _random_start(first: int, last: int, length: int, size: int, cell: int, rng: np.random.Generator) -> int:
    """Random start, a multiple of `cell`, of a crop of `length` pixels out of `size` that contains [first, last)."""
    lowest = max(-(-(last - length) // cell), 0)
    highest = min(first, size - length) // cell
    return cell * int(rng.integers(lowest, max(highest, lowest) + 1))
