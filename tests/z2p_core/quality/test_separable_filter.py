"""Sliding a kernel against torch's own convolution, and its gradient against differences."""

import pytest
import torch
import torch.nn.functional as F

from z2p_core.quality.separable_filter import BLOCK_WIDTH, correlate_rows, correlate_separable, gaussian_kernel


@pytest.mark.parametrize("width", [5, 8, BLOCK_WIDTH + 3, BLOCK_WIDTH + 4, 3 * BLOCK_WIDTH + 17])
def test_correlate_rows_is_a_valid_correlation(width: int) -> None:
    picture, kernel = torch.rand(2, 3, 7, width), torch.rand(5)
    expected = F.conv2d(picture.view(6, 1, 7, width), kernel.view(1, 1, 1, 5)).view(2, 3, 7, width - 4)
    torch.testing.assert_close(correlate_rows(picture, kernel), expected)


def test_correlate_separable_handles_rows_and_columns() -> None:
    picture, kernel = torch.rand(2, 1, 40, 50), torch.tensor([0.0, 0.0, 1.0, 0.0])
    torch.testing.assert_close(correlate_separable(picture, kernel), picture[..., 2:39, 2:49])


def test_gradient_matches_finite_differences() -> None:
    picture = torch.rand(2, 3, BLOCK_WIDTH + 9, dtype=torch.float64, requires_grad=True)
    kernel = torch.rand(6, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda rows: correlate_rows(rows, kernel).square(), picture)
    assert torch.autograd.gradcheck(
        lambda rows: correlate_rows(rows.transpose(-1, -2)[..., :6], torch.ones(2)), picture
    )


def test_gaussian_kernel_is_symmetric_and_normalised() -> None:
    kernel = gaussian_kernel(1.5, 5)
    torch.testing.assert_close(kernel, kernel.flip(0))
    torch.testing.assert_close(kernel.sum(), torch.tensor(1.0))
    torch.testing.assert_close((kernel * torch.arange(-5.0, 6) ** 2).sum().sqrt(), torch.tensor(1.5), atol=0.02, rtol=0)
