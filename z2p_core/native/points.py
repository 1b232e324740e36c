"""Kernels on bare clouds: neighbors, tangent planes, jets, noise, refined normals, coverage of an image."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from z2p_core.camera import Camera
from z2p_core.native.library import (
    FLOAT,
    FLOATS,
    FLOATS_OR_NONE,
    FLOATS_OUT,
    INT,
    INT64,
    INT64S_OUT,
    INTS,
    INTS_OUT,
    Handle,
    Struct,
    as_float32,
    call,
    declare,
    select_variant,
)
from z2p_core.native.screen_view import ScreenView, screen_view
from z2p_core.parallel import parallel_rows

MAX_BAND_CELLS = 1 << 21
"""Cells of an image whose points are merged at a time, so that their sums take about 120 MB a core."""

WALK = 256
"""Positions in a row that are found from each other (`c/points/neighbor_grid.c`)."""


class MergedRows(ctypes.Structure):
    """The C structure of that name (`c/points/visible_cells.c`)."""

    _fields_ = [
        ("first_row", ctypes.c_int),
        ("last_row", ctypes.c_int),
        ("merge_cells", ctypes.c_float),
        ("merge_depth", ctypes.c_float),
    ]


declare("z2p_grid_build", points=FLOATS, count=INT, sorted=FLOATS_OUT, grid=Handle("Grid**", is_output=True))
declare("z2p_grid_free", grid=Handle("Grid*"))
declare(
    "z2p_grid_neighbors", grid=Handle("const Grid*"), points=FLOATS, query_indices=INTS, count=INT, max_neighbors=INT,
    neighbors=INTS_OUT, spacing=FLOATS_OUT,
)  # fmt: skip
declare("z2p_grid_nearest", grid=Handle("const Grid*"), positions=FLOATS, count=INT, nearest=INTS_OUT)
declare(
    "z2p_grid_nearest_by_walk", grid=Handle("const Grid*"), neighbors=INTS, neighbor_count=INT, positions=FLOATS,
    begin=INT, end=INT, nearest=INTS_OUT,
)  # fmt: skip
declare(
    "z2p_fit_planes", points=FLOATS, neighbors=INTS, count=INT, neighbor_count=INT, normals=FLOATS_OUT,
    spread=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_fit_thin_slabs", points=FLOATS, query_indices=INTS, neighbors=INTS, count=INT, neighbor_count=INT, held=INT,
    widths=FLOATS_OUT, steep=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_fit_jets", points=FLOATS, normals_before=FLOATS, query_indices=INTS, neighbors=INTS, count=INT,
    neighbor_count=INT, tolerance=FLOATS, scale=FLOATS, normals=FLOATS_OUT, heights=FLOATS_OUT,
)  # fmt: skip
declare("z2p_normal_gnn_size", rounds=INTS_OUT, width=INTS_OUT)
declare("z2p_normal_gnn_begin", noise=FLOAT, count=INT, state=FLOATS_OUT, messages=FLOATS_OUT)
declare(
    "z2p_refine_normals", round_index=INT, points=FLOATS, normals=FLOATS, state=FLOATS, messages=FLOATS, neighbors=INTS,
    scale=FLOATS, begin=INT, end=INT, neighbor_count=INT, points_after=FLOATS_OUT, normals_after=FLOATS_OUT,
    state_after=FLOATS_OUT, messages_after=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_merge_visible", points=FLOATS, values=FLOATS_OR_NONE, count=INT64, view=Struct(ScreenView),
    rows=Struct(MergedRows), front=FLOATS, front_width=INT, front_height=INT, per_front=FLOAT, merged=FLOATS_OUT,
    merged_values=FLOATS_OUT, numbers=FLOATS_OUT, merged_count=INT64S_OUT,
)  # fmt: skip
declare(
    "z2p_interpolate_values", positions=FLOATS, normals=FLOATS, neighbors=INTS, begin=INT, end=INT, neighbor_count=INT,
    points=FLOATS, point_normals=FLOATS, values=FLOATS, value_count=INT, results=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_projected_coverage", points=FLOATS, count=INT, turns=FLOATS, views=INT, tilt=FLOATS, side=INT,
    covered=INTS_OUT, breadth=FLOATS_OUT,
)  # fmt: skip


@dataclass(frozen=True)
class MergedPoints:
    """Means of the points in M cells of an image."""

    points: np.ndarray
    """(M, 3) float32."""
    values: np.ndarray | None
    """(M, 3) float32, the means of values of the points, if there were some."""
    numbers: np.ndarray
    """(M,) float32, how many points each is the mean of."""


def merge_visible(
    points: np.ndarray, values: np.ndarray | None, camera: Camera, cells_per_pixel: float, merge_cells: float,
    merge_depth: float, front: np.ndarray, front_pixels: float,
) -> MergedPoints:  # fmt: skip
    """The points of a cloud that an image shows, joined where several lie in a cell of it. Their order does not matter.

    Args:
        points: (N, 3) float32, in world coordinates.
        values: (N, 3), of the points; None for none.
        camera: gives the image.
        cells_per_pixel: cells along a side of a pixel.
        merge_cells: how far behind the nearest point of its cell a point may lie to count, in widths of a cell ...
        merge_depth: ... plus this many world units.
        front: (h, w), depths over the image: a cell whose nearest point lies behind them is not shown.
        front_pixels: width of the square cells of `front`, in pixels.
    """
    view = screen_view(camera, 1 / cells_per_pixel)
    width, height = view.width, view.height
    cloud = (as_float32(points), None if values is None else as_float32(values), len(points), view)
    bands = max(2, -(-width * height // MAX_BAND_CELLS))
    parts: list[MergedPoints | None] = [None] * bands

    def merge(first: int, last: int) -> None:
        for band in range(first, last):
            rows = (band * height // bands, (band + 1) * height // bands)
            most = min(len(points), (rows[1] - rows[0]) * width)
            merged, merged_values = np.empty((max(most, 1), 3), np.float32), np.empty((max(most, 1), 3), np.float32)
            numbers, count = np.empty(max(most, 1), np.float32), np.zeros(1, np.int64)
            call(
                "z2p_merge_visible", *cloud, MergedRows(*rows, merge_cells, merge_depth), as_float32(front),
                front.shape[1], front.shape[0], front_pixels * cells_per_pixel, merged, merged_values, numbers, count,
            )  # fmt: skip
            kept = slice(int(count[0]))
            parts[band] = MergedPoints(
                merged[kept], None if values is None else merged_values[kept], numbers[kept]
            )  # fmt: skip

    parallel_rows(merge, bands, smallest=2, parts=bands)
    done = [part for part in parts if part is not None]
    means = None if values is None else np.concatenate([part.values for part in done if part.values is not None])
    return MergedPoints(
        np.concatenate([part.points for part in done]), means, np.concatenate([part.numbers for part in done])
    )


def interpolate_values(
    positions: np.ndarray, normals: np.ndarray, neighbors: np.ndarray, points: np.ndarray, point_normals: np.ndarray,
    values: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Values (M, C) at positions (M, 3) on a surface, from those of neighboring points (N, 3) of it.

    Args:
        positions: (M, 3).
        normals: (M, 3), unit length; neighbors with another normal weigh less.
        neighbors: (M, K) int32, K <= 64, rows of the points nearest to each position, nearest first.
        points: (N, 3).
        point_normals: (N, 3), unit length.
        values: (N, C), C <= 16.
    """
    results = np.empty((len(positions), values.shape[1]), np.float32)
    arrays = as_float32(positions), as_float32(normals), np.ascontiguousarray(neighbors, np.int32)
    surface = as_float32(points), as_float32(point_normals), as_float32(values)

    def interpolate(begin: int, end: int) -> None:
        call(
            "z2p_interpolate_values", *arrays, begin, end, neighbors.shape[1], *surface, values.shape[1], results
        )  # fmt: skip

    parallel_rows(interpolate, len(positions))
    return results


class NeighborGrid:
    """Nearest neighbors among the points of a cloud (N, 3), N >= 1.

    Attributes:
        points: (N, 3) float32, the cloud's points in an order that does not depend on the cloud's.

    Raises:
        ValueError: a coordinate is not finite.
    """

    def __init__(self, cloud: np.ndarray) -> None:
        self._handle = ctypes.c_void_p()  # first, as __del__ reads it also if the cloud is refused
        if not np.isfinite(cloud).all():
            raise ValueError("expected a cloud of finite points, got some that are not")
        self.points = np.empty((len(cloud), 3), np.float32)
        call("z2p_grid_build", as_float32(cloud), len(cloud), self.points, self._handle)

    def __del__(self) -> None:
        if self._handle:
            call("z2p_grid_free", self._handle)

    def neighbors(self, query_indices: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Neighbors (M, count) int32 of the points with these indices (M,), nearest first, and spacing (M,).

        A point is its own first neighbor; the last one is repeated if the cloud has fewer points. `count` <= 64.
        Spacing is the side of the square patch of surface that is a point's share, by its 12 nearest points.
        """
        return self._nearest(self.points, np.ascontiguousarray(query_indices, np.int32), count)

    def neighbors_of_positions(self, positions: np.ndarray, count: int) -> np.ndarray:
        """Indices (M, count) int32 of the points nearest to any positions (M, 3), nearest first; `count` <= 64.

        The last one is repeated if fewer are near.
        """
        return self._nearest(as_float32(positions), np.arange(len(positions), dtype=np.int32), count)[0]

    def nearest_to_positions(self, positions: np.ndarray) -> np.ndarray:
        """Indices (M,) int32 of the points nearest to any positions (M, 3); fastest where these are such points."""
        positions, nearest = as_float32(positions), np.empty(len(positions), np.int32)

        def find(begin: int, end: int) -> None:
            call("z2p_grid_nearest", self._handle, positions[begin:end], end - begin, nearest[begin:end])

        parallel_rows(find, len(positions))
        return nearest

    def nearest_by_walk(self, positions: np.ndarray, neighbors: np.ndarray) -> np.ndarray:
        """Indices (M,) int32 of the points nearest to positions (M, 3), of which most lie near the one before.

        Nearly all are those of `nearest_to_positions`, in a fraction of its time. `neighbors` (N, K) are the points'.
        """
        positions, neighbors = as_float32(positions), np.ascontiguousarray(neighbors, np.int32)
        nearest, blocks = np.empty(len(positions), np.int32), -(-len(positions) // WALK)

        def find(first: int, last: int) -> None:
            rows = (first * WALK, min(last * WALK, len(positions)))
            call("z2p_grid_nearest_by_walk", self._handle, neighbors, neighbors.shape[1], positions, *rows, nearest)

        parallel_rows(find, blocks, smallest=2)
        return nearest

    def _nearest(self, positions: np.ndarray, query_indices: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        neighbors = np.empty((len(query_indices), count), np.int32)
        spacing = np.empty(len(query_indices), np.float32)

        def find(begin: int, end: int) -> None:
            call(
                "z2p_grid_neighbors", self._handle, positions, query_indices[begin:end], end - begin, count,
                neighbors[begin:end], spacing[begin:end],
            )  # fmt: skip

        parallel_rows(find, len(query_indices))
        return neighbors, spacing


def fit_planes(points: np.ndarray, neighbors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Planes through neighbors (M, K) among points (N, 3): normals (M, 3), of either sign, and spread (M,).

    Spread is the neighbors' standard deviation off the plane.
    """
    count = len(neighbors)
    normals, spread = np.empty((count, 3), np.float32), np.empty(count, np.float32)

    def fit(begin: int, end: int) -> None:
        rows = slice(begin, end)
        call("z2p_fit_planes", points, neighbors[rows], end - begin, neighbors.shape[1], normals[rows], spread[rows])

    parallel_rows(fit, count)
    return normals, spread


def fit_thin_slabs(
    points: np.ndarray, query_indices: np.ndarray, neighbors: np.ndarray, held: int
) -> tuple[np.ndarray, np.ndarray]:
    """Half widths (M,) of the thinnest slabs that hold `held` of the neighbors, and the share (M,) of steep neighbors.

    A slab lies along two of the point's six nearest neighbors. A neighbor is steep if it lies above or below the point,
    by that slab, rather than beside it.

    Args:
        points: (N, 3) float32.
        query_indices: (M,), each the first of its own neighbors.
        neighbors: (M, K), K <= 16.
        held: how many of them a slab holds.
    """
    widths, steep = np.empty((2, len(query_indices)), np.float32)
    indices = (np.ascontiguousarray(query_indices, np.int32), np.ascontiguousarray(neighbors, np.int32))
    call("z2p_fit_thin_slabs", points, *indices, len(query_indices), neighbors.shape[1], held, widths, steep)
    return widths, steep


def fit_jets(
    points: np.ndarray, normals_before: np.ndarray, query_indices: np.ndarray, neighbors: np.ndarray,
    tolerance: np.ndarray, scale: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Second-order patches through neighborhoods: unit normals (M, 3), and heights (M,) of the points above them.

    A neighbor weighs less the farther it lies off the point's previous plane, the more its own previous normal differs,
    and the farther away it lies.

    Args:
        points: (N, 3) float32.
        normals_before: (N, 3) float32, unit normals of the previous planes.
        query_indices: (M,) int32, whose patches are fitted.
        neighbors: (M, K) int32, theirs.
        tolerance: (M,) float32, distance off the plane at which a weight falls to a quarter.
        scale: (M,) float32, length in which distances are measured.
    """
    normals, heights = np.empty((len(query_indices), 3), np.float32), np.empty(len(query_indices), np.float32)

    def fit(begin: int, end: int) -> None:
        rows = slice(begin, end)
        call(
            "z2p_fit_jets", points, normals_before, query_indices[rows], neighbors[rows], end - begin,
            neighbors.shape[1], tolerance[rows], scale[rows], normals[rows], heights[rows],
        )  # fmt: skip

    parallel_rows(fit, len(query_indices))
    return normals, heights


def refine_normals(
    points: np.ndarray, normals: np.ndarray, neighbors: np.ndarray, scale: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Refines positions (N, 3) and unit normals (N, 3) by the trained graph network (`scripts/train_normal_gnn.py`).

    Args:
        points: (N, 3).
        normals: (N, 3), unit normals of either sign.
        neighbors: (N, K).
        scale: (N,), above 0, length in which offsets to neighbors are measured.
        noise: standard deviation of the points off their surface, in spacings.
    """
    count, (rounds, width) = len(points), normal_gnn_size()
    node_state, messages = np.empty((2, count, width), np.float32)
    call("z2p_normal_gnn_begin", noise, count, node_state, messages)
    fields: tuple[np.ndarray, ...] = (as_float32(points), as_float32(normals), node_state, messages)
    scale, neighbors = as_float32(scale), np.ascontiguousarray(neighbors, np.int32)
    for round_index in range(rounds):
        fields = _run_round(round_index, fields, neighbors, scale)
    return fields[0], fields[1]


@lru_cache(maxsize=1)
def normal_gnn_size() -> tuple[int, int]:
    """Number of rounds of the network in `refine_normals`, and its width: values in the state of a point."""
    rounds, width = np.zeros((2, 1), np.int32)
    call("z2p_normal_gnn_size", rounds, width)
    return int(rounds[0]), int(width[0])


def _run_round(
    round_index: int, fields: tuple[np.ndarray, ...], neighbors: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Points (N, 3), normals (N, 3), states (N, W) and messages (N, W) after a round, from those before it."""
    after = tuple(np.empty_like(array) for array in fields)
    kernel = select_variant("z2p_refine_normals")

    def run(begin: int, end: int) -> None:
        call(kernel, round_index, *fields, neighbors, scale, begin, end, neighbors.shape[1], *after)

    parallel_rows(run, len(neighbors))
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
        "z2p_projected_coverage", as_float32(points), len(points), as_float32(rotations), len(turns), as_float32(tilt),
        side, covered, breadth,
    )  # fmt: skip
    return covered, breadth
