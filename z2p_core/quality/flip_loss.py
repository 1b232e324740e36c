"""FLIP (Andersson et al., FLIP: A Difference Evaluator for Alternating Images, 2020) as a training loss.

The map of `z2p_core.quality.metrics.flip_map` in torch, with gradients. Sections named below are the paper's. The one
change: differences too small to see are smoothed, because the gradient of their roots is infinite.
"""

from __future__ import annotations

import math
from functools import lru_cache

import torch
import torch.nn.functional as F
from torch import Tensor

from z2p_core.quality.metrics import PIXELS_PER_DEGREE
from z2p_core.quality.separable_filter import correlate_rows

FILTER_RADIUS = 10
"""Radius of the widest filter, pixels."""
LIGHTNESS_GAUSSIANS = ((1.0, 0.0047),)
RED_GREEN_GAUSSIANS = ((1.0, 0.0053),)
BLUE_YELLOW_GAUSSIANS = ((34.1, 0.04), (13.5, 0.025))
"""Amplitudes and widths of the Gaussians that make up the contrast sensitivity filters (table 1)."""
FEATURE_WIDTH_DEGREES = 0.082
"""Width of the edge and point detectors, degrees of visual angle."""
COLOR_POWER = 0.7
"""Exponent of colour differences (section 4.1.3)."""
FEATURE_POWER = 0.5
"""Exponent of feature differences (section 4.2)."""
KNEE_SHARE = 0.4
"""Share of the greatest colour difference up to which the error is linear (section 4.1.3)."""
KNEE_ERROR = 0.95
"""Error at that difference."""
COLOR_EPSILON = 0.02
"""Colour difference, in units of L*a*b*, below which it is smoothed."""
FEATURE_EPSILON = 5e-4
"""Feature difference, in lightness from 0 to 1, below which it is smoothed."""
XYZ_FROM_RGB = ((0.412387, 0.357591, 0.180450), (0.212637, 0.715183, 0.072180), (0.019331, 0.119195, 0.950373))
"""Matrix from linear sRGB to XYZ (D65)."""


def flip(ours: Tensor, theirs: Tensor) -> Tensor:
    """Error map (B, 1, H, W), from 0 to 1, between sRGB images (B, 3, H, W) in [0, 1], at 67 pixels a degree."""
    pairs = []
    for image in (ours, theirs):  # separately: usually only one of them needs gradients
        opponent = opponent_from_linear(linear_from_srgb(image.clamp(0, 1)))
        pairs.append((perceived_lab(opponent), feature_strength((opponent[:, :1] + 16) / 116)))
    colors, strengths = zip(*pairs, strict=True)
    return color_error(*colors) ** (1 - feature_error(*strengths))


def linear_from_srgb(image: Tensor) -> Tensor:
    """Linear values of sRGB ones."""
    return torch.where(image > 0.04045, ((image.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4, image / 12.92)


def opponent_from_linear(image: Tensor) -> Tensor:
    """Linear RGB (B, 3, H, W) in YCxCz: lightness, red against green, blue against yellow."""
    x, y, z = _transform_pixels(_relative_xyz_from_rgb(), image).unbind(1)
    return torch.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], 1)


def perceived_lab(opponent: Tensor) -> Tensor:
    """Hunt-adjusted L*a*b* (B, 3, H, W) of contrast-filtered YCxCz (B, 3, H, W) (sections 4.1.1, 4.1.2)."""
    channels = [_contrast_filtered(opponent[:, c : c + 1], parts) for c, parts in enumerate(_CONTRAST_FILTERS)]
    filtered = torch.cat(channels, 1)
    y = (filtered[:, :1] + 16) / 116
    relative = torch.cat([filtered[:, 1:2] / 500 + y, y, y - filtered[:, 2:] / 200], 1)
    shown = _transform_pixels(_relative_xyz_from_rgb().inverse(), relative).clamp(0, 1)
    return hunt_lab(shown)


def hunt_lab(linear: Tensor) -> Tensor:
    """L*a*b* (B, 3, H, W) of linear RGB (B, 3, H, W); chroma is scaled by lightness (Hunt effect, section 4.1.2)."""
    relative, edge = _transform_pixels(_relative_xyz_from_rgb(), linear), 6 / 29
    root = torch.where(relative > edge**3, relative.clamp_min(edge**3) ** (1 / 3), relative / (3 * edge**2) + 4 / 29)
    x, y, z = root.unbind(1)
    lightness = 116 * y - 16
    return torch.stack([lightness, 5 * (x - y) * lightness, 2 * (y - z) * lightness], 1)


def color_error(ours: Tensor, theirs: Tensor) -> Tensor:
    """Error (B, 1, H, W) in [0, 1] between L*a*b* images: HyAB distance, compressed (section 4.1.3)."""
    maximum = _max_color_difference()
    error = _hyab(ours, theirs) ** COLOR_POWER - COLOR_EPSILON**COLOR_POWER
    knee = KNEE_SHARE * maximum
    above = KNEE_ERROR + (error - knee) / (maximum - knee) * (1 - KNEE_ERROR)
    return torch.where(error < knee, error * (KNEE_ERROR / knee), above).clamp(1e-6, 1)


def feature_strength(lightness: Tensor) -> Tensor:
    """Strength of edges and of points (B, 2, H, W) in lightness (B, 1, H, W) from 0 to 1 (section 4.2)."""
    smooth, first, second = _feature_filters()
    across = {name: _filter(lightness, kernel, -1) for name, kernel in (("s", smooth), ("d", first), ("b", second))}
    pairs = (across["d"], smooth), (across["s"], first), (across["b"], smooth), (across["s"], second)
    responses = torch.cat([_filter(image, kernel, -2) for image, kernel in pairs], 1).square()
    squared = torch.stack([responses[:, 0] + responses[:, 1], responses[:, 2] + responses[:, 3]], 1)
    return squared.add(FEATURE_EPSILON**2).sqrt()


def feature_error(ours: Tensor, theirs: Tensor) -> Tensor:
    """Error (B, 1, H, W) in [0, 1] between strengths of edges and points (section 4.2)."""
    difference = (ours - theirs).abs().amax(1, keepdim=True) / math.sqrt(2)
    return (difference + FEATURE_EPSILON) ** FEATURE_POWER - FEATURE_EPSILON**FEATURE_POWER


def _hyab(ours: Tensor, theirs: Tensor) -> Tensor:
    difference = ours - theirs
    chroma = difference[:, 1:].square().sum(1, keepdim=True)
    return _length(difference[:, :1].square()) + _length(chroma) - COLOR_EPSILON


def _length(square: Tensor) -> Tensor:
    return (square + COLOR_EPSILON**2).sqrt()


def _transform_pixels(matrix: Tensor, image: Tensor) -> Tensor:
    """A matrix (3, 3) applied to each pixel of (B, 3, H, W)."""
    return torch.einsum("ac,bchw->bahw", matrix.to(image), image)


def _contrast_filtered(channel: Tensor, parts: tuple[tuple[float, Tensor], ...]) -> Tensor:
    return torch.stack([share * _filter(_filter(channel, kernel, -1), kernel, -2) for share, kernel in parts]).sum(0)


def _filter(image: Tensor, kernel: Tensor, axis: int) -> Tensor:
    """Images (B, C, H, W), borders replicated, correlated with a kernel (2 radius + 1,) along axis -1 or -2."""
    if axis == -2:
        return _filter(image.transpose(-1, -2), kernel, -1).transpose(-1, -2)
    return correlate_rows(F.pad(image, (FILTER_RADIUS, FILTER_RADIUS, 0, 0), mode="replicate"), kernel)


@lru_cache(maxsize=1)
def _relative_xyz_from_rgb() -> Tensor:
    """Matrix (3, 3) from linear RGB to XYZ, in which white is 1."""
    matrix = torch.tensor(XYZ_FROM_RGB, dtype=torch.float64)
    return (matrix / matrix.sum(1, keepdim=True)).float()


@lru_cache(maxsize=1)
def _max_color_difference() -> float:
    """HyAB distance between the two colours of sRGB that lie farthest apart, green and blue, to `COLOR_POWER`."""
    green, blue = (hunt_lab(torch.tensor(color).view(1, 3, 1, 1)) for color in ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    return float(_hyab(green, blue)) ** COLOR_POWER


@lru_cache(maxsize=1)
def _feature_filters() -> tuple[Tensor, Tensor, Tensor]:
    """A Gaussian and its first and second derivatives; their positive parts sum to 1, their negative ones to -1."""
    sigma = 0.5 * FEATURE_WIDTH_DEGREES * PIXELS_PER_DEGREE
    offset = torch.arange(-FILTER_RADIUS, FILTER_RADIUS + 1.0)
    gaussian = torch.exp(-(offset**2) / (2 * sigma**2)) * (offset.abs() <= math.ceil(3 * sigma))
    first, second = -offset * gaussian, (offset**2 / sigma**2 - 1) * gaussian
    derivatives = [torch.where(kernel > 0, kernel / kernel.clamp_min(0).sum(), kernel / -kernel.clamp_max(0).sum())
             for kernel in (first, second)]  # fmt: skip
    return gaussian / gaussian.sum(), derivatives[0], derivatives[1]


def _contrast_filter(gaussians: tuple[tuple[float, float], ...]) -> tuple[tuple[float, Tensor], ...]:
    """Shares, which sum to 1, and kernels (2 RADIUS + 1,) of the Gaussians that make up a filter."""
    degrees = torch.arange(-FILTER_RADIUS, FILTER_RADIUS + 1.0) / PIXELS_PER_DEGREE
    kernels = [torch.exp(-(math.pi**2) * degrees**2 / width) for _, width in gaussians]
    sums = [amplitude * math.sqrt(math.pi / width) * float(gaussian.sum()) ** 2
            for (amplitude, width), gaussian in zip(gaussians, kernels, strict=True)]  # fmt: skip
    return tuple((own / sum(sums), gaussian / gaussian.sum()) for own, gaussian in zip(sums, kernels, strict=True))


_CONTRAST_FILTERS = tuple(
    _contrast_filter(gaussians) for gaussians in (LIGHTNESS_GAUSSIANS, RED_GREEN_GAUSSIANS, BLUE_YELLOW_GAUSSIANS)
)
