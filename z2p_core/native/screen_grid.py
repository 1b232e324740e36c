"""Nearest neighbors among points that all show in one image."""

from __future__ import annotations

import math

import numpy as np

from z2p_core.camera import Camera
from z2p_core.native.library import FLOATS, FLOATS_OUT, INT, INTS, INTS_OUT, Struct, as_float32, call, declare
from z2p_core.native.screen_view import ScreenView, screen_view
from z2p_core.parallel import parallel_rows

POINTS_PER_CELL = 5.0
"""Mean number of points in the occupied cells of the screen: 3 by 3 of them hold a point's neighbors."""
AREA_CELLS = 96
"""Cells along the longer side of the image by which the area that the points cover is estimated."""
MIN_CELL_PIXELS = 0.25
BATCH = 16
"""Points that the kernel reads at a time, perhaps beyond the last one."""


declare(
    "z2p_screen_occupancy", points=FLOATS, count=INT, screen=Struct(ScreenView), occupied=INTS_OUT
)  # fmt: skip
declare(
    "z2p_screen_sort", points=FLOATS, count=INT, screen=Struct(ScreenView), sorted=FLOATS_OUT, columns=FLOATS_OUT,
    order=INTS_OUT, start=INTS_OUT,
)  # fmt: skip
declare(
    "z2p_screen_neighbors", columns=FLOATS, count=INT, start=INTS, screen=Struct(ScreenView),
    positions=FLOATS, begin=INT, end=INT, most=INT, neighbors=INTS_OUT, spacing=FLOATS_OUT,
)  # fmt: skip


class ScreenGrid:
    """Nearest neighbors among N >= 1 points that an image shows: a `NeighborGrid` that takes a sixth of its time.

    Neighbors are searched near a point on the screen, so that near the object's outline some of those that lie
    farthest may be missed for others.

    Attributes:
        points: (N, 3) float32, sorted by their places on the screen.
        order: (N,) int32, the row of each of them in the given points.
    """

    def __init__(self, points: np.ndarray, camera: Camera) -> None:
        """`points` (N, 3) float32, finite, in world units; the camera is that of the image that shows them."""
        points, count = as_float32(points), len(points)
        self._screen = _choose_cells(points, camera)
        self.points, self.order = np.empty((count, 3), np.float32), np.empty(count, np.int32)
        self._columns = np.empty((3, count + BATCH), np.float32)
        self._start = np.empty(self._screen.width * self._screen.height + 1, np.int32)
        call(
            "z2p_screen_sort", points, count, self._screen, self.points, self._columns, self.order, self._start
        )  # fmt: skip

    def neighbors(self, query_indices: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Neighbors (M, count) int32 and spacing (M,) as of `NeighborGrid.neighbors`."""
        return self._nearest(self.points[query_indices], count)

    def neighbors_of_positions(self, positions: np.ndarray, count: int) -> np.ndarray:
        """Indices (M, count) int32 of the points nearest to any positions (M, 3), nearest first; `count` <= 64."""
        return self._nearest(as_float32(positions), count)[0]

    def nearest_to_positions(self, positions: np.ndarray) -> np.ndarray:
        """Indices (M,) int32 of the points nearest to any positions (M, 3), among those near it on the screen."""
        return self._nearest(as_float32(positions), 1)[0][:, 0]

    def _nearest(self, positions: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        neighbors, spacing = np.empty((len(positions), count), np.int32), np.empty(len(positions), np.float32)

        def find(begin: int, end: int) -> None:
            call(
                "z2p_screen_neighbors", self._columns, len(self.points), self._start, self._screen, positions,
                begin, end, count, neighbors, spacing,
            )  # fmt: skip

        parallel_rows(find, len(positions))
        return neighbors, spacing


def _choose_cells(points: np.ndarray, camera: Camera) -> ScreenView:
    """Cells of which those that are not empty hold `POINTS_PER_CELL` of the points (N, 3) on average."""
    pixels, occupied = max(camera.width, camera.height) / AREA_CELLS, np.zeros(1, np.int32)
    call("z2p_screen_occupancy", points, len(points), screen_view(camera, pixels), occupied)
    area = int(occupied[0]) * pixels**2
    return screen_view(camera, max(math.sqrt(POINTS_PER_CELL * area / len(points)), MIN_CELL_PIXELS))
