"""Fills small gaps in the surfaces of a depth camera's cloud, where the camera measured nothing.

Shiny, dark or steep spots leave gaps of some pixels in its view. The cloud has no pixels, so a pixel grid is laid over
the view again: where a few pixels hold no point, and a surface continues on all four sides at about one depth, the
surface is interpolated. Anything that is visible through a gap, even far behind, is a point there and keeps it open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from z2p_core.interfaces import Sensor
from z2p_core.linalg import rotate_points
from z2p_core.surface.noise_level import median_spacing
from z2p_core.surface.subsampling import MAX_SURFACE_POINTS, subsample_hashed

PIXEL_SPACINGS = (1.5, 2.5, 4.0)
"""Sides of a pixel that are tried in turn, in the spacing of the points as the sensor sees them."""
MAX_GAP_SHARE = 0.02
"""Largest number of filled pixels, as a share of the occupied ones: more gaps come from uneven sampling. Then larger
pixels are tried, and if these have as many gaps, nothing is filled."""
MAX_GAP_SPACINGS = 12
"""Largest width of a gap that is filled, in spacings."""
MAX_DEPTH_SLOPE = 3.0
"""Largest difference of the depths around a gap, in the gap's width: that of a table seen from 18 degrees above it.
Structured-light and stereo cameras miss a strip behind each step in depth; it is narrower than this, by distance over
baseline, so it stays open."""
MAX_PIXELS_PER_POINT = 20.0
"""Largest number of pixels per point; sparser points are no camera's picture."""
MAX_VIEW_TANGENT = 2.0
"""Largest tangent of the angle between a point and the sensor's axis; wider views are no camera's."""


def fill_depth_gaps(points: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Points (M, 3) float64, one per pixel, that fill small gaps in a depth camera's points (N, 3); M may be 0."""
    view = rotate_points(points - sensor.position, sensor.rotation.T)
    nothing = np.empty((0, 3))
    if not len(view) or view[:, 2].min() <= 0:
        return nothing
    across, depth = view[:, :2] / view[:, 2:], view[:, 2]
    spacing = _spacing(across)
    if spacing <= 0 or np.abs(across).max() > MAX_VIEW_TANGENT:
        return nothing
    for side in PIXEL_SPACINGS:
        gap_points, share = _fill_gaps(across, depth, side * spacing, int(MAX_GAP_SPACINGS / side))
        if share <= MAX_GAP_SHARE:
            moved: np.ndarray = rotate_points(gap_points, sensor.rotation) + sensor.position
            return moved
    return nothing


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
    """Mean depth (H, W) of the points in each pixel, and a mask (H, W) bool of the empty pixels.

    The points have depths (N,) and pixel coordinates `places` (N, 2), from 0 on. The mean is NaN where the standard
    deviation is over `spread` times the mean: the end of a gap there would lie between two surfaces.
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
    """For each pixel (H, W), the interpolation between the nearest occupied pixels of its row to the left and right."""

    first: np.ndarray
    """(H, W), depth of the left one."""
    last: np.ndarray
    """(H, W), depth of the right one."""
    length: np.ndarray
    """(H, W), pixels from the left one to the right one."""
    between: np.ndarray
    """(H, W), interpolated depth at the pixel."""

    def transposed(self) -> _Bridges:
        """The same arrays with rows and columns exchanged."""
        return _Bridges(self.first.T, self.last.T, self.length.T, self.between.T)


def _bridges(picture: np.ndarray, empty: np.ndarray) -> _Bridges:
    """Bridges over the rows of depths (H, W); without an occupied pixel on one side, the length exceeds the row's."""
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
