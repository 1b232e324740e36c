"""What a picture of the network costs: the paper's terms (section 3.4) and those beside them. Premultiplied RGBA.

Every term is a mean over pixels and channels, 0 for equal pictures. In shapes, B is the batch.
"""

from __future__ import annotations

import torch
from torch import Tensor

from z2p_core.config import LossConfig
from z2p_core.quality.flip_loss import flip
from z2p_core.quality.separable_filter import gaussian_kernel, correlate_separable

SSIM_WINDOW, SSIM_SIGMA = 11, 1.5
SSIM_STABILIZERS = (0.01**2, 0.03**2)
VISIBLE_SIGMA, VISIBLE_POWER = 1.03, 0.7
"""Of FLIP's filter for lightness at 67 pixels a degree, in pixels, and of its exponent."""
VISIBLE_EPSILON = 1 / 255
"""Smaller differences than a step of a finished picture count by their square, so that gradients stay finite."""
FLIP_EVERY = 4
"""FLIP of all pictures would make a step a third longer: it looks at the first of so many."""


def total_loss(
    prediction: Tensor, target: Tensor, coverage: Tensor, config: LossConfig
) -> tuple[Tensor, dict[str, Tensor]]:
    """The weighted sum of the terms of `config`, and each term, unweighted and detached, by its name.

    Pictures are (B, 4, H, W) float32, colour times alpha and alpha; coverage (B, 1, H, W) in [0, 1] is the object's.

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
    """Weight (B, 1, H, W) of each pixel's colour error; `masked` keeps the object's pixels, averaged over them."""
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
    """Mean absolute step to the right and downwards of a difference of pictures (B, C, H, W): its edges."""
    right = difference[..., :, 1:] - difference[..., :, :-1]
    down = difference[..., 1:, :] - difference[..., :-1, :]
    return (right.abs().mean() + down.abs().mean()) / 2


def rgb_on_white(picture: Tensor) -> Tensor:
    """RGB (B, 3, H, W) of a premultiplied picture laid on white."""
    return picture[:, :3] + 1 - picture[:, 3:]


def visible_difference(first: Tensor, second: Tensor) -> Tensor:
    """Visible difference (B, 1, H-10, W-10) of sRGB pictures (B, 3, H, W): the colour term of FLIP, made simple.

    What a viewer at 67 pixels a degree cannot resolve is blurred away, and what is left counts by its power of 0.7
    (Andersson et al., FLIP, 2020). FLIP does that in spaces made for the eye; sRGB is near enough to learn from.
    """
    square = gaussian_blur(first - second, VISIBLE_SIGMA).square().mean(1, keepdim=True)
    return (square + VISIBLE_EPSILON**2) ** (VISIBLE_POWER / 2) - VISIBLE_EPSILON**VISIBLE_POWER


def grey_on_white(picture: Tensor) -> Tensor:
    """Mean of the channels (B, 1, H, W) of a premultiplied picture laid on white."""
    return picture[:, :3].mean(1, keepdim=True) + 1 - picture[:, 3:]


def ssim(first: Tensor, second: Tensor) -> Tensor:
    """Structural similarity (B, 1, H-10, W-10) of pictures (B, 1, H, W) in [0, 1]; Gaussian window 11, sigma 1.5.

    The window stays inside the picture. The second one's statistics get no gradient: it is what is learnt from.
    """
    mean_a, square_a, product = gaussian_blur(torch.stack([first, first * first, first * second]))
    with torch.no_grad():
        mean_b, square_b = gaussian_blur(torch.stack([second, second * second]))
    c1, c2 = SSIM_STABILIZERS
    similarity = (2 * mean_a * mean_b + c1) * (2 * (product - mean_a * mean_b) + c2)
    return similarity / ((mean_a**2 + mean_b**2 + c1) * (square_a - mean_a**2 + square_b - mean_b**2 + c2))


def gaussian_blur(picture: Tensor, sigma: float = SSIM_SIGMA) -> Tensor:
    """Pictures (..., H, W) under a Gaussian window that stays inside them: (..., H - 10, W - 10).

    Raises:
        ValueError: a side is shorter than the window.
    """
    side = min(picture.shape[-2:])
    if side < SSIM_WINDOW:
        raise ValueError(f"loss: expected pictures of {SSIM_WINDOW} pixels a side or more, got {side}")
    return correlate_separable(picture, gaussian_kernel(sigma, SSIM_WINDOW // 2))
