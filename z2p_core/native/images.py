"""Bindings of `c/image/`: z-buffers of points, the network's last convolutions, and the finished image's pixels.

Images are planar, (channels, H, W). Arrays are float32 unless said otherwise; others are converted, except for outputs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from z2p_core.camera import Camera
from z2p_core.native.library import (
    BYTES_OUT,
    FLOAT,
    FLOAT_ROWS,
    FLOATS,
    FLOATS_OUT,
    INT,
    INT64,
    Struct,
    as_float32,
    call,
    check_output,
    declare,
    select_variant,
)
from z2p_core.native.screen_view import ScreenView, screen_view
from z2p_core.parallel import parallel_rows

MIN_PARALLEL_ROWS = 400
"""Rows of an image from which on two cores composite it."""
MIN_PARALLEL_CONV_ROWS = 64
"""Rows of an image from which on two cores convolve it."""
CHANNEL_GROUP = 4
"""Output channels that the convolution kernel computes at a time (`GROUP` in `c/image/final_convs.c`)."""

declare(
    "z2p_nearest_depth", points=FLOATS, count=INT64, view=Struct(ScreenView), margin=INT,
    depths=FLOATS_OUT,
)  # fmt: skip
declare("z2p_window_minimum", image=FLOATS, height=INT, width=INT, size=INT, out=FLOATS_OUT)
declare(
    "z2p_depth_to_intensity", depth=FLOAT_ROWS, stride=INT64, height=INT, width=INT, alpha=FLOAT, beta=FLOAT,
    out=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_blend_towards", image=FLOATS_OUT, coverage=FLOATS, colors=FLOATS, pixels=INT64, first=INT64, last=INT64,
    weight=FLOAT, max_difference=FLOAT,
)  # fmt: skip
declare(
    "z2p_blend_shadow_towards", alpha=FLOATS_OUT, coverage=FLOATS, shadow=FLOATS, first=INT64, last=INT64,
    weight=FLOAT, max_difference=FLOAT,
)  # fmt: skip
declare(
    "z2p_multiply_linear", image=FLOATS_OUT, factors=FLOATS, coverage=FLOATS, coarse=FLOATS, full_coverage=FLOAT,
    height=INT, width=INT, first=INT, last=INT,
)  # fmt: skip
declare(
    "z2p_extend_halved", values=FLOATS, weights=FLOATS, scale=FLOAT, height=INT, width=INT, half=FLOATS_OUT,
)  # fmt: skip
declare("z2p_to_straight_rgba8", image=FLOATS, pixels=INT64, first=INT64, last=INT64, rgba=BYTES_OUT)
declare(
    "z2p_final_convs", cells=FLOATS, buffers=FLOATS, channels=INT, height=INT, width=INT, unshuffle=INT,
    first_weights=FLOATS, first_bias=FLOATS, groups=INT, last_weights=FLOATS, last_bias=FLOATS, begin=INT, end=INT,
    image=FLOATS_OUT,
)  # fmt: skip


def nearest_depth(cloud: np.ndarray, camera: Camera, margin: int, pixels_per_cell: float = 1.0) -> np.ndarray:
    """Depth (H + 2 margin, W + 2 margin) of the nearest point in each cell, infinity where there is none.

    Args:
        cloud: (N, 3), points in world coordinates. A point falls into the one cell that holds its projection.
        camera: gives the image; H and W are its size in cells.
        margin: cells that are added beyond each border of the image.
        pixels_per_cell: width of the square cells.
    """
    view = screen_view(camera, pixels_per_cell)
    height, width = view.height + 2 * margin, view.width + 2 * margin
    depths = np.full(height * width + 1, np.inf, np.float32)  # the last one takes the points outside
    call("z2p_nearest_depth", as_float32(cloud), len(cloud), view, margin, depths)
    return depths[:-1].reshape(height, width)


def window_minimum(image: np.ndarray, size: int) -> np.ndarray:
    """Minimum (H - size + 1, W - size + 1) of every size x size window of an image (H, W)."""
    height, width = image.shape
    out = np.empty((height - size + 1, width - size + 1), np.float32)
    call("z2p_window_minimum", as_float32(image), height, width, size, out)
    return out


def depth_to_intensity(depth: np.ndarray, alpha: float, beta: float, out: np.ndarray) -> None:
    """Draws exp((alpha - depth) / beta) into `out` (H, W), 0 where the depth is infinite: Eq. 1 of the Z2P paper.

    Args:
        depth: (H, W) float32, may be a slice of a wider array.
        alpha: depth of intensity 1.
        beta: increase of depth by which the intensity falls to 1 / e.
        out: C-contiguous.

    Raises:
        ValueError: an array has another shape or dtype, or is not contiguous.
    """
    if depth.dtype != np.float32 or depth.strides[1] != 4:
        raise ValueError(f"expected float32 depths in contiguous rows, got {depth.dtype}, strides {depth.strides}")
    height, width = depth.shape
    rows_apart = depth.strides[0] // 4
    call("z2p_depth_to_intensity", depth, rows_apart, height, width, alpha, beta, check_output(out, (height, width)))


def blend_towards(
    image: np.ndarray, coverage: np.ndarray, colors: np.ndarray, weight: float, max_difference: float
) -> None:
    """Blends an image in place towards given colors, where both the image and the coverage are opaque.

    Args:
        image: (4, H, W), premultiplied RGBA.
        coverage: (H, W), in [0, 1].
        colors: (3, H, W), straight RGB.
        weight: share of the difference that is added to the image.
        max_difference: differences of premultiplied color are clipped to it.

    Raises:
        ValueError: `image` has another shape or dtype, or is not contiguous.
    """
    _, height, width = image.shape
    planes = (check_output(image, (4, height, width)), as_float32(coverage), as_float32(colors), height * width)

    def blend(top: int, bottom: int) -> None:
        call("z2p_blend_towards", *planes, top * width, bottom * width, weight, max_difference)

    parallel_rows(blend, height, MIN_PARALLEL_ROWS, parts=2)


def blend_shadow_towards(
    alpha: np.ndarray, coverage: np.ndarray, shadow: np.ndarray, weight: float, max_difference: float
) -> None:
    """Blends an image's alpha in place towards a given shadow, where the coverage is about 0.

    Args:
        alpha: (H, W).
        coverage: (H, W), in [0, 1].
        shadow: (H, W), the alpha to blend towards.
        weight: share of the difference that is added.
        max_difference: larger differences count less, and not at all from twice that on.

    Raises:
        ValueError: `alpha` has another dtype, or is not contiguous.
    """
    height, width = alpha.shape
    planes = (check_output(alpha, (height, width)), as_float32(coverage), as_float32(shadow))

    def blend(top: int, bottom: int) -> None:
        call("z2p_blend_shadow_towards", *planes, top * width, bottom * width, weight, max_difference)

    parallel_rows(blend, height, MIN_PARALLEL_ROWS, parts=2)


def extend_halved(values: np.ndarray, weights: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Values (3, H, W) at half the resolution, (3, ceil(H / 2), ceil(W / 2)), everywhere: means weighted by `weights`.

    Where there are none of any weight in a block of 2 x 2 pixels, they are means over larger blocks around it:
    pull-push interpolation (Gortler et al., The Lumigraph, 1996). Weights (H, W) times `scale` count up to 1.
    """
    height, width = weights.shape
    half = np.empty((3, (height + 1) // 2, (width + 1) // 2), np.float32)
    call("z2p_extend_halved", as_float32(values), as_float32(weights), scale, height, width, half)
    return half


def multiply_linear(image: np.ndarray, factors: np.ndarray, coverage: np.ndarray, full_coverage: float) -> None:
    """Multiplies the colors of an image (4, H, W), premultiplied sRGB and alpha, in linear light, in place.

    Straight colors are clipped to [0, 1] before and after.

    Args:
        image: C-contiguous.
        factors: (3, H, W), at least 0.
        coverage: (H, W), in [0, 1]; a pixel's factor counts as far as its coverage is full, else that of pixels near.
        full_coverage: coverage that is full, above 0.

    Raises:
        ValueError: `image` has another dtype, or is not contiguous.
    """
    height, width = image.shape[1:]
    image, factors, coverage = check_output(image, (4, height, width)), as_float32(factors), as_float32(coverage)
    coarse = extend_halved(factors, coverage, 1 / full_coverage)

    def multiply(begin: int, end: int) -> None:
        call("z2p_multiply_linear", image, factors, coverage, coarse, full_coverage, height, width, begin, end)

    parallel_rows(multiply, height, MIN_PARALLEL_ROWS)


def to_straight_rgba8(image: np.ndarray) -> np.ndarray:
    """Straight RGBA (H, W, 4) uint8 of a premultiplied image (4, H, W), clipped to [0, 1]; black where alpha is 0."""
    _, height, width = image.shape
    rgba = np.empty((height, width, 4), np.uint8)
    planes = (as_float32(image), height * width)

    def convert(top: int, bottom: int) -> None:
        call("z2p_to_straight_rgba8", *planes, top * width, bottom * width, rgba)

    parallel_rows(convert, height, MIN_PARALLEL_ROWS, parts=2)
    return rgba


class Convolution(NamedTuple):
    """A 3x3 convolution in the order in which `final_convs` reads it, float32.

    Attributes:
        weights: (O / 4, I, 9, 4).
        bias: (O / 4, 4).
    """

    weights: np.ndarray
    bias: np.ndarray


def pack_convolution(weights: np.ndarray, bias: np.ndarray) -> Convolution:
    """Packs a 3x3 convolution of weights (O, I, 3, 3) and bias (O,), O a multiple of `CHANNEL_GROUP`."""
    groups = weights.reshape(-1, CHANNEL_GROUP, weights.shape[1], weights.shape[2] * weights.shape[3])
    return Convolution(as_float32(groups.transpose(0, 2, 3, 1)), as_float32(bias.reshape(-1, CHANNEL_GROUP)))


def final_convs(
    cells: np.ndarray, buffers: np.ndarray, cell: int, first: Convolution, last: Convolution, out: np.ndarray
) -> None:
    """Draws into `out` (4, H, W) an image plus two convolutions of it and of buffers, clipped to [0, 1].

    Args:
        cells: (4 cell^2, H / cell, W / cell), the image as torch's `pixel_unshuffle` folds it.
        buffers: (C, H, W).
        cell: pixels along a side of a cell.
        first: reads the image's 4 channels and then the buffers; a ReLU follows. Both pad with zeros.
        last: from the first's outputs to 4 channels.
        out: C-contiguous.

    Raises:
        ValueError: shapes that do not fit each other; `out` has another shape or dtype, or is not contiguous.
    """
    channels, height, width = buffers.shape
    fits = (cells.shape, len(first.weights[0]), len(last.weights[0])) == (
        (CHANNEL_GROUP * cell**2, height / cell, width / cell), CHANNEL_GROUP + channels, first.bias.size
    )  # fmt: skip
    if not fits or last.bias.size != CHANNEL_GROUP:
        raise ValueError(
            f"expected cells of {cell} pixels a side, buffers and convolutions that fit each other, got {cells.shape}, "
            f"{buffers.shape}, {first.weights.shape} and {last.weights.shape}"
        )
    inputs = (as_float32(cells), as_float32(buffers), channels, height, width, cell)
    layers = (first.weights, first.bias, len(first.weights), last.weights, last.bias)
    image = check_output(out, (CHANNEL_GROUP, height, width))
    kernel = select_variant("z2p_final_convs")

    def convolve(top: int, bottom: int) -> None:
        call(kernel, *inputs, *layers, top, bottom, image)

    parallel_rows(convolve, height, MIN_PARALLEL_CONV_ROWS)
