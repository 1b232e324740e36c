"""Sliding a short kernel along pictures: what SSIM and FLIP are made of, quick to learn through on a CPU.

Rows are cut into overlapping pieces, which one product with a banded matrix filters all. A convolution of few channels
takes many times as long, and automatic differentiation of the cutting twice as long as the same product once more.
"""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor

BLOCK_WIDTH = 32
"""Values that a product gives of a piece."""


def gaussian_kernel(sigma: float, radius: int) -> Tensor:
    """Kernel (2 radius + 1,) float32 of that standard deviation, whose sum is 1."""
    bell = torch.exp(-(torch.arange(-radius, radius + 1.0) ** 2) / (2 * sigma**2))
    return bell / bell.sum()


def correlate_rows(picture: Tensor, kernel: Tensor) -> Tensor:
    """A picture (..., W) correlated with a kernel (K,) along its rows, inside them: (..., W - K + 1)."""
    slid: Tensor = _CorrelateRows.apply(picture, kernel)
    return slid


def correlate_separable(picture: Tensor, kernel: Tensor) -> Tensor:
    """A picture (..., H, W) correlated with a kernel (K,) along rows and columns: (..., H - K + 1, W - K + 1)."""
    return correlate_rows(correlate_rows(picture, kernel).transpose(-1, -2), kernel).transpose(-1, -2)


class _CorrelateRows(torch.autograd.Function):
    """The gradient slides too: along a border of zeros, with the kernel turned round."""

    @staticmethod
    def forward(ctx: Any, picture: Tensor, kernel: Tensor) -> Tensor:
        ctx.kernel = kernel
        return _correlate(picture, kernel)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        border = len(ctx.kernel) - 1
        return _correlate(F.pad(gradients[0], (border, border)), ctx.kernel.flip(0)), None


def _correlate(picture: Tensor, kernel: Tensor) -> Tensor:
    side, more = picture.shape[-1] - len(kernel) + 1, len(kernel) - 1
    pieces = F.pad(picture, (0, -side % BLOCK_WIDTH)).unfold(-1, BLOCK_WIDTH + more, BLOCK_WIDTH)
    found = pieces.reshape(-1, BLOCK_WIDTH + more) @ _band_matrix(kernel.to(picture))  # of one matrix, not of many small ones
    return found.view(*picture.shape[:-1], -1)[..., :side]


def _band_matrix(kernel: Tensor) -> Tensor:
    """Matrix (PIECE + K - 1, PIECE) whose columns hold the kernel, each a row lower than the one before."""
    last = len(kernel) - 1
    rows, columns = (torch.arange(count, device=kernel.device) for count in (BLOCK_WIDTH + last, BLOCK_WIDTH))
    place = rows[:, None] - columns
    return torch.where((place >= 0) & (place <= last), kernel[place.clamp(0, last)], 0)
