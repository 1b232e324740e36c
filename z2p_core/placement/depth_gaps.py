"""What a depth camera failed to measure in the midst of a surface, put in.

Shiny, dark or steep spots leave gaps of some pixels in its view. A cloud has no pixels any more, so they are laid over
the view anew: where a few of them hold no point, and a surface goes on to all four sides at about one depth, it goes on
between. What the view shows through a gap, even far behind, is a point there, and keeps it open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from z2p_core.interfaces import Sensor
from z2p_core.linalg import rotate_points
from z2p_core.surface.noise_level import median_spacing
from z2p_core.surface.subsampling import MAX_SURFACE_POINTS, subsample_hashed

PIXEL_SPACINGS = (1.5, 2.5, 4.0)
"""Sides of a pixel, in the spacing of the points that the sensor sees. On an even grid each holds some."""
MAX_GAP_SHARE = 0.02
"""Gaps that are more than this share of the pixels that hold points come from how these are spread, rather than from
what was lost. Larger pixels may tell; else the points are no camera's, and stay as they are."""
MAX_GAP_SPACINGS = 12
"""How wide a gap may be, in spacings."""
MAX_DEPTH_SLOPE = 3.0
"""Most that the depths around a gap may differ by, in its width: as on a table that is looked at 18 degrees from above.
Behind a step a camera that projects or compares misses a strip narrower than that, by distance over baseline."""
MAX_PIXELS_PER_POINT = 20.0
"""Pixels for each point up to which these can fill a camera's picture."""
MAX_VIEW_TANGENT = 2.0
"""Tangent of the angle off the sensor's axis within which all points lie, if it is a camera."""


def fill_depth_gaps(points: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Points (M, 3) float64, one a pixel, for the gaps in surfaces of points (N, 3) as their depth camera sees them."""
    view = rotate_points(points - sensor.position, sensor.rotation.T)
    none = np.empty((0, 3))
    if not len(view) or view[:, 2].min() <= 0:
        return none
    across, depth = view[:, :2] / view[:, 2:], view[:, 2]
    spacing = _spacing(across)
    if spacing <= 0 or np.abs(across).max() > MAX_VIEW_TANGENT:
        return none
    for side in PIXEL_SPACINGS:
        gap_points, share = _fill_gaps(across, depth, side * spacing, int(MAX_GAP_SPACINGS / side))
        if share <= MAX_GAP_SHARE:
            moved: np.ndarray = rotate_points(gap_points, sensor.rotation) + sensor.position
            return moved
    return none


def _fill_gaps(across: np.ndarray, depth: np.ndarray, pixel: float, max_pixels: int) -> tuple[np.ndarray, float]:
    """Points (M, 3) in the sensor's axes that fill gaps of up to `max_pixels`, and M over the occupied pixels.

    Args:
        across: (N, 2), the points' positions in the image plane at depth 1.
        depth: (N,).
        pixel: side of a pixel at depth 1.
        max_pixels: width of the widest gap that is filled.
    """
    corner = across.min(axis=0)
    if np.prod(np.ptp(across, axis=0) / pixel) > MAX_PIXELS_PER_POINT * len(across):
        return np.empty((0, 3)), np.inf
    picture, empty = _picture(((across - corner) / pixel).astype(np.int64), depth, MAX_DEPTH_SLOPE * pixel / 2)
    rows, columns = _bridges(picture, empty), _bridges(picture.T, empty.T).transposed()
    ends = np.stack([rows.first, rows.last, columns.first, columns.last])
    widest = np.maximum(rows.length, columns.length)
    flat = np.ptp(ends, axis=0) <= MAX_DEPTH_SLOPE * widest * pixel * ends.mean(axis=0)
    closed = empty & flat & (widest <= max_pixels + 1)
    between = (rows.between * columns.length + columns.between * rows.length) / (rows.length + columns.length)
    places = np.argwhere(closed)[:, ::-1]
    rays = np.column_stack([(places + 0.5) * pixel + corner, np.ones(len(places))])
    return rays * between[closed][:, None], len(places) / np.count_nonzero(~empty)


def _picture(places: np.ndarray, depth: np.ndarray, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean depth (H, W) of points (N,) in pixels at places (N, 2), from 0 on; and which hold none, (H, W) bool.

    NaN where depths spread by more than that share of their mean: a gap's end there would lie between two surfaces.
    """
    width, height = (int(last) + 1 for last in places.max(axis=0))
    pixel = places[:, 1] * width + places[:, 0]
    held = np.bincount(pixel, minlength=width * height)
    sums = (np.bincount(pixel, power, minlength=width * height) for power in (depth, depth**2))
    mean, square = (total / np.maximum(held, 1) for total in sums)
    mean[square - mean**2 > (spread * mean) ** 2] = np.nan
    return mean.reshape(height, width), (held == 0).reshape(height, width)


@dataclass(frozen=True)
class _Bridges:
    """For each pixel (H, W) the nearest ones in its row that hold points: depth of the first and the last, how many
    steps lie from one to the other, and the depth between them where the pixel is."""

    first: np.ndarray
    last: np.ndarray
    length: np.ndarray
    between: np.ndarray

    def transposed(self) -> _Bridges:
        """Of a picture whose rows and columns were exchanged, in that picture's own order."""
        return _Bridges(self.first.T, self.last.T, self.length.T, self.between.T)


def _bridges(picture: np.ndarray, empty: np.ndarray) -> _Bridges:
    """Bridges over the rows of depths (H, W); where a row is open to one side, they are longer than it."""
    width = picture.shape[1]
    place, rows = np.arange(width), np.arange(len(picture))[:, None]
    before = np.maximum.accumulate(np.where(empty, -width, place), axis=1)
    after = np.minimum.accumulate(np.where(empty, 2 * width, place)[:, ::-1], axis=1)[:, ::-1]
    first, last = picture[rows, np.maximum(before, 0)], picture[rows, np.minimum(after, width - 1)]
    length = np.maximum(after - before, 1)
    return _Bridges(first, last, length, first + (last - first) * (place - before) / length)


def _spacing(across: np.ndarray) -> float:
    """Spacing of positions (N, 2) in the image plane."""
    flat = np.column_stack([across, np.zeros(len(across))]).astype(np.float32)
    sample = subsample_hashed(flat, MAX_SURFACE_POINTS)
    return median_spacing(sample) * float(np.sqrt(len(sample) / len(flat)))
