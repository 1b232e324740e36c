"""Training loss of premultiplied RGBA images: the paper's terms (section 3.4) and further ones.

Every term is a mean over pixels and channels, 0 for equal images. In shapes, B is the batch.
"""

from __future__ import annotations

import torch
from torch import Tensor

from z2p_core.config import LossConfig
from z2p_core.quality.flip_loss import flip
from z2p_core.quality.metrics import SSIM_WINDOW
from z2p_core.quality.separable_filter import correlate_separable, gaussian_kernel

SSIM_SIGMA = 1.5
"""Standard deviation of the Gaussian window of structural similarity, pixels."""
SSIM_STABILIZERS = (0.01**2, 0.03**2)
"""C1 and C2 of Wang et al. (2004) for values in [0, 1]."""
VISIBLE_SIGMA = 1.03
"""Standard deviation of FLIP's lightness filter at 67 pixels a degree, pixels."""
VISIBLE_POWER = 0.7
"""FLIP's exponent of colour differences."""
VISIBLE_EPSILON = 1 / 255
"""Differences below one 8-bit step count by their squared, which keeps gradients finite."""
FLIP_EVERY = 4
"""FLIP is computed for every fourth image of a batch: for all of them a step would take a third longer."""


def total_loss(
    prediction: Tensor, target: Tensor, coverage: Tensor, config: LossConfig
) -> tuple[Tensor, dict[str, Tensor]]:
    """Weighted sum of the terms of `config`, and each term, unweighted and detached, by its name.

    `prediction` and `target` are premultiplied RGBA (B, 4, H, W) float32; `coverage` (B, 1, H, W) in [0, 1] is the
    object's share of each pixel.

    Raises:
        ValueError: every weight is 0.
    """
    weight = color_weight(coverage, config)
    color, true_color = prediction[:, :3], target[:, :3]
    terms = {
        "color_l2": lambda: weighted_mean((color - true_color).square(), weight),
        "magnitude_l1": lambda: weighted_mean((magnitude(color) - magnitude(true_color)).abs(), weight),
        "alpha_l1": lambda: (prediction[:, 3:] - target[:, 3:]).abs().mean(),
        "color_l1": lambda: weighted_mean((color - true_color).abs(), weight),
        "ssim": lambda: 1 - ssim(grey_on_white(prediction), grey_on_white(target)).mean(),
        "gradient_l1": lambda: gradient_l1(prediction - target),
        "visible": lambda: visible_difference(rgb_on_white(prediction), rgb_on_white(target)).mean(),
        "flip": lambda: flip(rgb_on_white(prediction[::FLIP_EVERY]), rgb_on_white(target[::FLIP_EVERY])).mean(),
    }
    values = {name: term() for name, term in terms.items() if getattr(config, name)}
    if not values:
        raise ValueError(f"loss: expected a weight above 0 for one of {', '.join(terms)}")
    total = torch.stack([getattr(config, name) * value for name, value in values.items()]).sum()
    return total, {name: value.detach() for name, value in values.items()}


def color_weight(coverage: Tensor, config: LossConfig) -> Tensor:
    """Weight (B, 1, H, W) of each pixel's colour error; with `config.masked` the mean is over the object's pixels."""
    weight = 1 + config.foreground * coverage
    if config.masked:
        mask = (coverage > 0).to(coverage.dtype)
        weight = weight * mask / mask.mean().clamp_min(1e-6)
    return weight


def weighted_mean(error: Tensor, weight: Tensor) -> Tensor:
    """Mean of (B, C, H, W) errors times (B, 1, H, W) weights."""
    return (error * weight).mean()


def magnitude(color: Tensor) -> Tensor:
    """Length (B, 1, H, W) of each pixel's colour; the small constant keeps the gradient finite at black."""
    return (color.square().sum(1, keepdim=True) + 1e-6).sqrt()


def gradient_l1(difference: Tensor) -> Tensor:
    """Mean absolute gradient, by finite differences along rows and columns, of an image difference (B, C, H, W)."""
    right = difference[..., :, 1:] - difference[..., :, :-1]
    down = difference[..., 1:, :] - difference[..., :-1, :]
    return (right.abs().mean() + down.abs().mean()) / 2


def rgb_on_white(image: Tensor) -> Tensor:
    """RGB (B, 3, H, W) of a premultiplied image composited on white."""
    return image[:, :3] + 1 - image[:, 3:]


def visible_difference(first: Tensor, second: Tensor) -> Tensor:
    """Visible difference (B, 1, H-10, W-10) of sRGB images (B, 3, H, W): a simplified colour term of FLIP.

    A blur removes what a viewer at 67 pixels a degree cannot resolve; the rest counts by its power of 0.7 (Andersson et
    al., FLIP, 2020). FLIP works in perceptual colour spaces; for a loss, sRGB is close enough.
    """
    squared = gaussian_blur(first - second, VISIBLE_SIGMA).square().mean(1, keepdim=True)
    return (squared + VISIBLE_EPSILON**2) ** (VISIBLE_POWER / 2) - VISIBLE_EPSILON**VISIBLE_POWER


def grey_on_white(image: Tensor) -> Tensor:
    """Mean of the channels (B, 1, H, W) of a premultiplied image composited on white."""
    return image[:, :3].mean(1, keepdim=True) + 1 - image[:, 3:]


def ssim(first: Tensor, second: Tensor) -> Tensor:
    """Structural similarity (B, 1, H-10, W-10) of images (B, 1, H, W) in [0, 1] (Wang et al. 2004).

    Gaussian window of 11 pixels, sigma 1.5, inside the image. `second`, the target, gets no gradient.
    """
    mean_a, square_a, product = gaussian_blur(torch.stack([first, first * first, first * second]))
    with torch.no_grad():
        mean_b, square_b = gaussian_blur(torch.stack([second, second * second]))
    c1, c2 = SSIM_STABILIZERS
    similarity = (2 * mean_a * mean_b + c1) * (2 * (product - mean_a * mean_b) + c2)
    return similarity / ((mean_a**2 + mean_b**2 + c1) * (square_a - mean_a**2 + square_b - mean_b**2 + c2))


def gaussian_blur(image: Tensor, sigma: float = SSIM_SIGMA) -> Tensor:
    """Images (..., H, W) filtered by a Gaussian window that stays inside them: (..., H - 10, W - 10).

    Raises:
        ValueError: a side is shorter than the window.
    """
    side = min(image.shape[-2:])
    if side < SSIM_WINDOW:
        raise ValueError(f"loss: expected pictures of {SSIM_WINDOW} pixels a side or more, got {side}")
    return correlate_separable(image, gaussian_kernel(sigma, SSIM_WINDOW // 2))
