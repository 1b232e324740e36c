"""Kernels that find a bare cloud's neighbours, and the planes and patches through them."""

from __future__ import annotations

import ctypes
from functools import lru_cache

import numpy as np

from z2p_core.native.library import (
    FLOAT,
    FLOATS,
    FLOATS_OUT,
    INT,
    INTS,
    INTS_OUT,
    Handle,
    as_float32,
    call,
    declare,
    select_variant,
)
from z2p_core.parallel import parallel_rows

GRID, GRID_TO_FREE = Handle("const Grid*"), Handle("Grid*")
GRID_OUT = Handle("Grid**", is_output=True)

declare(
    "z2p_jets", points=FLOATS, before=FLOATS, asked=INTS, found=INTS, count=INT, most=INT, tolerance=FLOATS,
    scale=FLOATS, normals=FLOATS_OUT, heights=FLOATS_OUT,
)  # fmt: skip
declare("z2p_refine_size", rounds=INTS_OUT, width=INTS_OUT)
declare("z2p_refine_begin", noise=FLOAT, count=INT, memory=FLOATS_OUT, told=FLOATS_OUT)
declare(
    "z2p_refine", which=INT, points=FLOATS, normals=FLOATS, memory=FLOATS, told=FLOATS, found=INTS, scale=FLOATS,
    begin=INT, end=INT, most=INT, points_after=FLOATS_OUT, normals_after=FLOATS_OUT, memory_after=FLOATS_OUT,
    told_after=FLOATS_OUT,
)  # fmt: skip
declare("z2p_grid", points=FLOATS, count=INT, sorted=FLOATS_OUT, handle=GRID_OUT)
declare("z2p_grid_free", grid=GRID_TO_FREE)
declare("z2p_neighbours", grid=GRID, points=FLOATS, asked=INTS, count=INT, most=INT, found=INTS_OUT, spacing=FLOATS_OUT)
declare("z2p_planes", points=FLOATS, found=INTS, count=INT, most=INT, normals=FLOATS_OUT, spread=FLOATS_OUT)
declare(
    "z2p_slabs", points=FLOATS, asked=INTS, found=INTS, count=INT, most=INT, held=INT, widths=FLOATS_OUT,
    steep=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_showing", points=FLOATS, count=INT, turns=FLOATS, views=INT, tilt=FLOATS, side=INT, covered=INTS_OUT,
    breadth=FLOATS_OUT,
)  # fmt: skip


class NeighborGrid:
    """A cloud (N, 3), N >= 1, whose points are sorted by place, so that neighbours are found at once.

    Attributes:
        points: (N, 3) float32, in an order that does not depend on the cloud's.
    """

    def __init__(self, cloud: np.ndarray) -> None:
        self._handle = ctypes.c_void_p()  # first: what refuses the cloud leaves a grid to be deleted
        if not np.isfinite(cloud).all():
            raise ValueError("expected a cloud of finite points, got some that are not")
        self.points = np.empty((len(cloud), 3), np.float32)
        call("z2p_grid", as_float32(cloud), len(cloud), self.points, self._handle)

    def __del__(self) -> None:
        if self._handle:
            call("z2p_grid_free", self._handle)

    def neighbors(self, asked: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows of `points` (M, count) int32, count <= 64, nearest to the points asked for (M,) int32, and spacing (M,).

        A point is its own neighbour, and the last neighbour is repeated where a cloud has fewer. Spacing is the side of
        the square patch of surface that is a point's share, by its 12 nearest points.
        """
        return self._nearest(self.points, np.ascontiguousarray(asked, np.int32), count)

    def neighbors_of_positions(self, places: np.ndarray, count: int) -> np.ndarray:
        """Rows of `points` (M, count) int32, count <= 64, nearest to places (M, 3) that need be none of them.

        The last one is repeated where fewer are near.
        """
        return self._nearest(as_float32(places), np.arange(len(places), dtype=np.int32), count)[0]

    def _nearest(self, places: np.ndarray, asked: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        found, spacing = np.empty((len(asked), count), np.int32), np.empty(len(asked), np.float32)
        grid = (self._handle, places)

        def find(begin: int, end: int) -> None:
            call("z2p_neighbours", *grid, asked[begin:end], end - begin, count, found[begin:end], spacing[begin:end])

        parallel_rows(find, len(asked))
        return found, spacing


def fit_planes(points: np.ndarray, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Planes through the neighbours found (M, K) among points (N, 3): normals (M, 3), of either sign, and spread (M,).

    Spread is the neighbours' standard deviation off the plane.
    """
    count = len(found)
    normals, spread = np.empty((count, 3), np.float32), np.empty(count, np.float32)

    def fit(begin: int, end: int) -> None:
        rows = slice(begin, end)
        call("z2p_planes", points, found[rows], end - begin, found.shape[1], normals[rows], spread[rows])

    parallel_rows(fit, count)
    return normals, spread


def fit_thin_slabs(points: np.ndarray, asked: np.ndarray, found: np.ndarray, held: int) -> tuple[np.ndarray, np.ndarray]:
    """The thinnest slabs that hold so many of the neighbours found (M, K <= 16) of points (N, 3): half widths (M,).

    And the share (M,) of neighbours that lie above or below the point, by that slab, rather than beside it. The points
    asked for (M,) int32 are each the first of their own neighbours; a slab lies along two of the nearest six others.
    """
    widths, steep = np.empty((2, len(asked)), np.float32)
    rows = (np.ascontiguousarray(asked, np.int32), np.ascontiguousarray(found, np.int32))
    call("z2p_slabs", points, *rows, len(asked), found.shape[1], held, widths, steep)
    return widths, steep


def fit_jets(
    points: np.ndarray, before: np.ndarray, asked: np.ndarray, found: np.ndarray, tolerance: np.ndarray,
    scale: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Normals (M, 3) of curved patches through the neighbours found (M, K) of points asked for (M,), and heights (M,).

    A height is how far the point lies above its patch, along the normal. Those neighbours count most that lie near the
    plane by its normal of `before` (N, 3), within tolerances (M,), that agree with it, and that are near by scale (M,).
    """
    normals, heights = np.empty((len(asked), 3), np.float32), np.empty(len(asked), np.float32)

    def fit(begin: int, end: int) -> None:
        of_rows = (array[begin:end] for array in (tolerance, scale, normals, heights))
        call("z2p_jets", points, before, asked[begin:end], found[begin:end], end - begin, found.shape[1], *of_rows)

    parallel_rows(fit, len(asked))
    return normals, heights


def refine_normals(
    points: np.ndarray, normals: np.ndarray, found: np.ndarray, scale: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) moved onto their patches and unit normals (N, 3), as each agrees with its neighbours found (N, K).

    A small graph network (`scripts/learn_patches.py`) that passes messages some times, from points (N, 3), unit
    normals (N, 3) of either sign and the noise in spacings. Steps are measured in scale (N,), above 0.
    """
    count, (rounds, width) = len(points), normal_gnn_size()
    memory, told = np.empty((2, count, width), np.float32)
    call("z2p_refine_begin", noise, count, memory, told)
    state: tuple[np.ndarray, ...] = (as_float32(points), as_float32(normals), memory, told)
    scale, found = as_float32(scale), np.ascontiguousarray(found, np.int32)
    for which in range(rounds):
        state = _next_round(which, state, found, scale)
    return state[0], state[1]


@lru_cache(maxsize=1)
def normal_gnn_size() -> tuple[int, int]:
    """Rounds of messages in `refine_normals`, and how many numbers W a point remembers from one to the next."""
    rounds, width = np.zeros((2, 1), np.intc)
    call("z2p_refine_size", rounds, width)
    return int(rounds[0]), int(width[0])


def _next_round(
    which: int, state: tuple[np.ndarray, ...], found: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, ...]:
    """The points, normals, memory (N, W) and what is told (N, W) after that round, from those before it."""
    after = tuple(np.empty_like(array) for array in state)
    kernel = select_variant("z2p_refine")

    def send(begin: int, end: int) -> None:
        call(kernel, which, *state, found, scale, begin, end, found.shape[1], *after)

    parallel_rows(send, len(found))
    return after


def projected_coverage(
    points: np.ndarray, turns: np.ndarray, elevation: float, side: int
) -> tuple[np.ndarray, np.ndarray]:
    """How much of an image the points cover in views from afar: pixels (V,) int32, and the points' breadth (V,).

    Args:
        points: (N, 3), in the unit sphere.
        turns: (V,), angles in radians by which a view turns the points about z.
        elevation: of the camera, in radians.
        side: of the images, in pixels; each point covers 3 x 3 of them.
    """
    covered, breadth = np.empty(len(turns), np.int32), np.empty(len(turns), np.float32)
    rotations = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    tilt = np.array([np.sin(elevation), np.cos(elevation)])
    call(
        "z2p_showing", as_float32(points), len(points), as_float32(rotations), len(turns), as_float32(tilt), side,
        covered, breadth,
    )  # fmt: skip
    return covered, breadth
