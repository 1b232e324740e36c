"""Kernels that draw: points and discs into buffers, and the finished picture's bytes."""

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
    as_float32,
    call,
    check_output,
    declare,
    select_variant,
)
from z2p_core.parallel import parallel_rows

declare(
    "z2p_reconcile", planes=FLOATS_OUT, coverage=FLOATS, colors=FLOATS, pixels=INT64, first=INT64, last=INT64,
    trust=FLOAT, most=FLOAT,
)  # fmt: skip
declare(
    "z2p_reconcile_shadow", alpha=FLOATS_OUT, coverage=FLOATS, given=FLOATS, first=INT64, last=INT64, trust=FLOAT,
    most=FLOAT,
)  # fmt: skip
declare("z2p_straight_bytes", planes=FLOATS, pixels=INT64, first=INT64, last=INT64, rgba=BYTES_OUT)
declare(
    "z2p_touch", cells=FLOATS, buffers=FLOATS, channels=INT, height=INT, width=INT, unshuffle=INT, look_weights=FLOATS,
    look_bias=FLOATS, groups=INT, touch_weights=FLOATS, touch_bias=FLOATS, begin=INT, end=INT, picture=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_nearest_depth", points=FLOATS, count=INT64, camera=FLOATS, focal=FLOAT, width=INT, height=INT, margin=INT,
    depths=FLOATS_OUT,
)  # fmt: skip
declare("z2p_window_minimum", picture=FLOATS, height=INT, width=INT, size=INT, out=FLOATS_OUT)
declare("z2p_intensity", depth=FLOAT_ROWS, stride=INT64, height=INT, width=INT, alpha=FLOAT, beta=FLOAT, out=FLOATS_OUT)

SHORTEST = 400
"""Rows of a picture below which one core converts them."""
FEWEST = 64
"""Rows below which one core goes over them with convolutions."""
GROUP = 4
"""Channels that those kernels write at a time."""


class Convolution(NamedTuple):
    """A 3x3 convolution for `touched`: weights (O / 4, I, 9, 4) and bias (O / 4, 4), float32."""

    weights: np.ndarray
    bias: np.ndarray


def nearest_depth(cloud: np.ndarray, camera: Camera, margin: int) -> np.ndarray:
    """Depth (H + 2 margin, W + 2 margin) of the nearest of points (N, 3) in each pixel, infinity where there is none.

    A point falls into the pixel that holds its projection; `margin` pixels beyond each border are kept.
    """
    height, width = camera.height + 2 * margin, camera.width + 2 * margin
    depths = np.full(height * width + 1, np.inf, np.float32)  # the last takes the points that are not seen
    view = np.concatenate([camera.rotation.ravel(), camera.position])
    call(
        "z2p_nearest_depth", as_float32(cloud), len(cloud), as_float32(view), camera.focal,
        width, height, margin, depths,
    )  # fmt: skip
    return depths[:-1].reshape(height, width)


def window_minimum(picture: np.ndarray, size: int) -> np.ndarray:
    """Minimum (H - size + 1, W - size + 1) of every size x size window of (H, W)."""
    height, width = picture.shape
    out = np.empty((height - size + 1, width - size + 1), np.float32)
    call("z2p_window_minimum", as_float32(picture), height, width, size, out)
    return out


def showing(points: np.ndarray, turns: np.ndarray, elevation: float, side: int) -> tuple[np.ndarray, np.ndarray]:
    """What views from afar show of points (N, 3) in the unit sphere: cells covered (V,) int32, and breadth (V,).

    A view turns the points about Z by an angle of `turns` (V,), and looks at them from the elevation, all in radians.
    Cells are those of a picture (side, side), each point a dot of 3 x 3.
    """
    covered, breadth = np.empty(len(turns), np.int32), np.empty(len(turns), np.float32)
    ways = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    tilt = np.array([np.sin(elevation), np.cos(elevation)])
    call(
        "z2p_showing",
        as_float32(points),
        len(points),
        as_float32(ways),
        len(turns),
        as_float32(tilt),
        side,
        covered,
        breadth,
    )
    return covered, breadth


def intensity(depth: np.ndarray, alpha: float, beta: float, out: np.ndarray) -> None:
    """Draws into `out` (H, W) exp((alpha - depth) / beta) of depths (H, W), whose rows may lie apart; 0 of infinity."""
    if depth.dtype != np.float32 or depth.strides[1] != 4:
        raise ValueError(f"expected float32 depths whose rows are whole, got {depth.dtype}, strides {depth.strides}")
    height, width = depth.shape
    call(
        "z2p_intensity", depth, depth.strides[0] // 4, height, width, alpha,
        beta, check_output(out, (height, width)),
    )  # fmt: skip


def reconcile(picture: np.ndarray, coverage: np.ndarray, colors: np.ndarray, trust: float, most: float) -> None:
    """Moves a picture (4, H, W), colour times alpha and alpha, towards given straight colours (3, H, W), in place.

    By the share `trust`, and where they differ by more than `most` by that of it; in the midst of what both coverage
    (H, W) and alpha show whole, and nowhere else. All are float32 and contiguous.
    """
    _, height, width = picture.shape
    planes = (check_output(picture, (4, height, width)), as_float32(coverage), as_float32(colors), height * width)

    def move(top: int, bottom: int) -> None:
        rows = (top * width, bottom * width)
        call("z2p_reconcile", *planes, *rows, trust, most)

    parallel_rows(move, height, SHORTEST, parts=2)


def reconcile_shadow(alpha: np.ndarray, coverage: np.ndarray, shadow: np.ndarray, trust: float, most: float) -> None:
    """Moves a picture's alpha (H, W) towards a given shadow's (H, W), in place, where coverage (H, W) shows nothing.

    By the share `trust` where they differ by up to `most`, less where by more, and not at all from twice that on. All
    are float32 and contiguous.
    """
    height, width = alpha.shape
    planes = (check_output(alpha, (height, width)), as_float32(coverage), as_float32(shadow))

    def move(top: int, bottom: int) -> None:
        rows = (top * width, bottom * width)
        call("z2p_reconcile_shadow", *planes, *rows, trust, most)

    parallel_rows(move, height, SHORTEST, parts=2)


def straight_bytes(picture: np.ndarray) -> np.ndarray:
    """Straight RGBA (H, W, 4) uint8 of colour times alpha, and alpha (4, H, W); clipped, colour 0 where alpha is."""
    _, height, width = picture.shape
    out = np.empty((height, width, 4), np.uint8)
    planes = (as_float32(picture), height * width)

    def convert(top: int, bottom: int) -> None:
        call("z2p_straight_bytes", *planes, top * width, bottom * width, out)

    parallel_rows(convert, height, SHORTEST, parts=2)
    return out


def packed(weights: np.ndarray, bias: np.ndarray) -> Convolution:
    """A 3x3 convolution of weights (O, I, 3, 3) and bias (O,), as kernels take it."""
    groups = weights.reshape(-1, GROUP, weights.shape[1], weights.shape[2] * weights.shape[3])
    return Convolution(as_float32(groups.transpose(0, 2, 3, 1)), as_float32(bias.reshape(-1, GROUP)))


def touched(
    cells: np.ndarray, buffers: np.ndarray, cell: int, look: Convolution, touch: Convolution, out: np.ndarray
) -> None:
    """Draws into `out` (4, H, W) a picture, and what two convolutions see in it and in buffers (C, H, W) add to it.

    The picture comes in cells (4 cell^2, H / cell, W / cell), as torch's `pixel_unshuffle` folds it. `look` reads it
    before the buffers, `touch` what is positive of that. Beyond the borders all is 0; the sum is clipped to [0, 1].
    """
    channels, height, width = buffers.shape
    fits = (cells.shape, len(look.weights[0]), len(touch.weights[0])) == (
        (GROUP * cell**2, height / cell, width / cell), GROUP + channels, look.bias.size
    )  # fmt: skip
    if not fits or touch.bias.size != GROUP:
        raise ValueError(
            f"expected cells of {cell} pixels a side, buffers and convolutions that fit each other, got {cells.shape}, "
            f"{buffers.shape}, {look.weights.shape} and {touch.weights.shape}"
        )
    drawn = (as_float32(cells), as_float32(buffers), channels, height, width, cell)
    layers = (look.weights, look.bias, len(look.weights), touch.weights, touch.bias)
    picture = check_output(out, (GROUP, height, width))
    kernel = select_variant("z2p_touch")
    parallel_rows(lambda top, bottom: call(kernel, *drawn, *layers, top, bottom, picture), height, FEWEST)
