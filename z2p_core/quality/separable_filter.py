"""Separable correlation with a short kernel, for SSIM and FLIP; differentiable and fast on a CPU.

Rows are cut into overlapping blocks, which are all filtered by one product with a banded matrix. A convolution of few
channels takes many times as long; autograd through the cutting takes twice as long as the explicit gradient here.
"""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor

BLOCK_WIDTH = 32
"""Output values per block."""


def gaussian_kernel(sigma: float, radius: int) -> Tensor:
    """Gaussian kernel (2 radius + 1,) float32 of standard deviation `sigma`, normalised to sum 1."""
    bell = torch.exp(-(torch.arange(-radius, radius + 1.0) ** 2) / (2 * sigma**2))
    return bell / bell.sum()


def correlate_rows(image: Tensor, kernel: Tensor) -> Tensor:
    """Valid correlation of images (..., W) with a kernel (K,) along their rows: (..., W - K + 1)."""
    filtered: Tensor = _CorrelateRows.apply(image, kernel)
    return filtered


def correlate_separable(image: Tensor, kernel: Tensor) -> Tensor:
    """Valid correlation of images (..., H, W) with a kernel (K,) along both axes: (..., H - K + 1, W - K + 1)."""
    return correlate_rows(correlate_rows(image, kernel).transpose(-1, -2), kernel).transpose(-1, -2)


class _CorrelateRows(torch.autograd.Function):
    """Its gradient is a correlation of the zero-padded gradient with the flipped kernel."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, kernel: Tensor) -> Tensor:
        ctx.kernel = kernel
        return _correlate(image, kernel)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        border = len(ctx.kernel) - 1
        return _correlate(F.pad(gradients[0], (border, border)), ctx.kernel.flip(0)), None


def _correlate(image: Tensor, kernel: Tensor) -> Tensor:
    overlap = len(kernel) - 1
    width = image.shape[-1] - overlap
    blocks = F.pad(image, (0, -width % BLOCK_WIDTH)).unfold(-1, BLOCK_WIDTH + overlap, BLOCK_WIDTH)
    # one large matrix product, not a batch of small ones
    filtered = blocks.reshape(-1, BLOCK_WIDTH + overlap) @ _band_matrix(kernel.to(image))
    return filtered.view(*image.shape[:-1], -1)[..., :width]


def _band_matrix(kernel: Tensor) -> Tensor:
    """Matrix (PIECE + K - 1, PIECE) whose column i holds the kernel from row i on."""
    last = len(kernel) - 1
    rows, columns = (torch.arange(count, device=kernel.device) for count in (BLOCK_WIDTH + last, BLOCK_WIDTH))
    offset = rows[:, None] - columns
    return torch.where((offset >= 0) & (offset <= last), kernel[offset.clamp(0, last)], 0)
