"""FLIP (Andersson et al., FLIP: A Difference Evaluator for Alternating Images, 2020), to learn from.

The map that `z2p_core.quality.metrics.flip_map` measures with, in torch, so that it has gradients. Colour and features are
compared as they are in the paper, whose sections are named below; only differences too small to see are rounded off,
for their roots have no slope.
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
"""Pixels that the widest filter reaches to every side."""
LIGHTNESS_GAUSSIANS, RED_GREEN_GAUSSIANS, BLUE_YELLOW_GAUSSIANS = ((1.0, 0.0047),), ((1.0, 0.0053),), ((34.1, 0.04), (13.5, 0.025))
"""Amplitudes and widths of the Gaussians that are the eye's filters (table 1)."""
FEATURE_WIDTH_DEGREES = 0.082
"""Of an edge or a point that the eye finds, in degrees."""
COLOR_POWER, FEATURE_POWER = 0.7, 0.5
KNEE_SHARE, KNEE_ERROR = 0.4, 0.95
"""Share of the greatest colour difference up to which errors grow in proportion, and the error there (section 4.1)."""
COLOR_EPSILON, FEATURE_EPSILON = 0.02, 5e-4
"""Differences, in the units of L*a*b* and of lightness, below which they are rounded off."""
XYZ_FROM_RGB = ((0.412387, 0.357591, 0.180450), (0.212637, 0.715183, 0.072180), (0.019331, 0.119195, 0.950373))
"""Of sRGB's primaries and D65."""


def flip(ours: Tensor, theirs: Tensor) -> Tensor:
    """Error map (B, 1, H, W), from 0 to 1, between sRGB pictures (B, 3, H, W) in [0, 1], at 67 pixels a degree."""
    pairs = []
    for picture in (ours, theirs):  # apart, for one of them rarely wants gradients
        opponent = opponent_from_linear(linear_from_srgb(picture.clamp(0, 1)))
        pairs.append((perceived_lab(opponent), feature_strength((opponent[:, :1] + 16) / 116)))
    colors, found = zip(*pairs, strict=True)
    return color_error(*colors) ** (1 - feature_error(*found))


def linear_from_srgb(picture: Tensor) -> Tensor:
    """Linear values of sRGB ones."""
    return torch.where(picture > 0.04045, ((picture.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4, picture / 12.92)


def opponent_from_linear(picture: Tensor) -> Tensor:
    """Linear RGB (B, 3, H, W) in YCxCz: lightness, red against green, blue against yellow."""
    x, y, z = _transform_pixels(_relative_xyz_from_rgb(), picture).unbind(1)
    return torch.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], 1)


def perceived_lab(opponent: Tensor) -> Tensor:
    """L*a*b* (B, 3, H, W), the duller the darker (Hunt), of what the eye resolves of YCxCz (sections 4.1.1, 4.1.2)."""
    filtered = torch.cat([_contrast_filtered(opponent[:, c : c + 1], parts) for c, parts in enumerate(_CONTRAST_FILTERS)], 1)
    y = (filtered[:, :1] + 16) / 116
    relative = torch.cat([filtered[:, 1:2] / 500 + y, y, y - filtered[:, 2:] / 200], 1)
    shown = _transform_pixels(_relative_xyz_from_rgb().inverse(), relative).clamp(0, 1)
    return hunt_lab(shown)


def hunt_lab(linear: Tensor) -> Tensor:
    """L*a*b* (B, 3, H, W) of linear RGB, with colour that fades as lightness does."""
    relative, edge = _transform_pixels(_relative_xyz_from_rgb(), linear), 6 / 29
    root = torch.where(relative > edge**3, relative.clamp_min(edge**3) ** (1 / 3), relative / (3 * edge**2) + 4 / 29)
    x, y, z = root.unbind(1)
    lightness = 116 * y - 16
    return torch.stack([lightness, 5 * (x - y) * lightness, 2 * (y - z) * lightness], 1)


def color_error(ours: Tensor, theirs: Tensor) -> Tensor:
    """Error (B, 1, H, W) in [0, 1] between L*a*b* pictures: HyAB's distance, compressed (section 4.1.3)."""
    most = _max_color_difference()
    error = _hyab(ours, theirs) ** COLOR_POWER - COLOR_EPSILON**COLOR_POWER
    knee = KNEE_SHARE * most
    above = KNEE_ERROR + (error - knee) / (most - knee) * (1 - KNEE_ERROR)
    return torch.where(error < knee, error * (KNEE_ERROR / knee), above).clamp(1e-6, 1)


def feature_strength(lightness: Tensor) -> Tensor:
    """Strength of edges and of points (B, 2, H, W) in lightness (B, 1, H, W) from 0 to 1 (section 4.2)."""
    smooth, slope, bend = _feature_filters()
    across = {name: _filter(lightness, kernel, -1) for name, kernel in (("s", smooth), ("d", slope), ("b", bend))}
    pairs = (across["d"], smooth), (across["s"], slope), (across["b"], smooth), (across["s"], bend)
    found = torch.cat([_filter(picture, kernel, -2) for picture, kernel in pairs], 1).square()
    return torch.stack([found[:, 0] + found[:, 1], found[:, 2] + found[:, 3]], 1).add(FEATURE_EPSILON**2).sqrt()


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


def _transform_pixels(matrix: Tensor, picture: Tensor) -> Tensor:
    """A matrix (3, 3) times each pixel of (B, 3, H, W)."""
    return torch.einsum("ac,bchw->bahw", matrix.to(picture), picture)


def _contrast_filtered(channel: Tensor, parts: tuple[tuple[float, Tensor], ...]) -> Tensor:
    return torch.stack([share * _filter(_filter(channel, kernel, -1), kernel, -2) for share, kernel in parts]).sum(0)


def _filter(picture: Tensor, kernel: Tensor, axis: int) -> Tensor:
    """A picture (B, C, H, W), its border repeated, correlated with a kernel (2 RADIUS + 1,) along its last or last but
    one axis."""
    if axis == -2:
        return _filter(picture.transpose(-1, -2), kernel, -1).transpose(-1, -2)
    return correlate_rows(F.pad(picture, (FILTER_RADIUS, FILTER_RADIUS, 0, 0), mode="replicate"), kernel)


@lru_cache(maxsize=1)
def _relative_xyz_from_rgb() -> Tensor:
    """Matrix (3, 3) from linear RGB to XYZ, in which white is 1."""
    matrix = torch.tensor(XYZ_FROM_RGB, dtype=torch.float64)
    return (matrix / matrix.sum(1, keepdim=True)).float()


@lru_cache(maxsize=1)
def _max_color_difference() -> float:
    """Between the colours that lie farthest apart, green and blue, compressed."""
    green, blue = (hunt_lab(torch.tensor(color).view(1, 3, 1, 1)) for color in ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    return float(_hyab(green, blue)) ** COLOR_POWER


@lru_cache(maxsize=1)
def _feature_filters() -> tuple[Tensor, Tensor, Tensor]:
    """A Gaussian, its slope and its curvature (2 RADIUS + 1,); the parts above and below 0 sum to 1 and -1."""
    sigma = 0.5 * FEATURE_WIDTH_DEGREES * PIXELS_PER_DEGREE
    place = torch.arange(-FILTER_RADIUS, FILTER_RADIUS + 1.0)
    bell = torch.exp(-(place**2) / (2 * sigma**2)) * (place.abs() <= math.ceil(3 * sigma))
    slope, bend = -place * bell, (place**2 / sigma**2 - 1) * bell
    whole = [torch.where(kernel > 0, kernel / kernel.clamp_min(0).sum(), kernel / -kernel.clamp_max(0).sum())
             for kernel in (slope, bend)]  # fmt: skip
    return bell / bell.sum(), whole[0], whole[1]


def _contrast_filter(gaussians: tuple[tuple[float, float], ...]) -> tuple[tuple[float, Tensor], ...]:
    """Shares, which sum to 1, and kernels (2 RADIUS + 1,) of the Gaussians that make up a filter."""
    degrees = torch.arange(-FILTER_RADIUS, FILTER_RADIUS + 1.0) / PIXELS_PER_DEGREE
    bells = [torch.exp(-(math.pi**2) * degrees**2 / width) for _, width in gaussians]
    sums = [amplitude * math.sqrt(math.pi / width) * float(bell.sum()) ** 2
            for (amplitude, width), bell in zip(gaussians, bells, strict=True)]  # fmt: skip
    return tuple((own / sum(sums), bell / bell.sum()) for own, bell in zip(sums, bells, strict=True))


_CONTRAST_FILTERS = tuple(_contrast_filter(gaussians) for gaussians in (LIGHTNESS_GAUSSIANS, RED_GREEN_GAUSSIANS, BLUE_YELLOW_GAUSSIANS))
