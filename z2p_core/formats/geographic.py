"""Detects points whose x and y are longitude and latitude in degrees, and converts them to local metres."""

from __future__ import annotations

import math

import numpy as np

from z2p_core.linalg import bounding_box

METRES_PER_DEGREE = 111_320.0
"""Length of a degree of latitude, and of longitude at the equator."""
_MIN_HEIGHT_TO_WIDTH, _CERTAIN_HEIGHT_TO_WIDTH = 30.0, 1000.0
"""Ratio of the z range to the x or y range of a cloud in degrees: the least one, and one that nothing else has."""
_MAX_SPAN_DEGREES, _MAX_LATITUDE_DEGREES = 20.0, 85.0
"""Largest extent of a cloud in degrees, and the largest latitude, north or south, of its points."""
_MIN_OFFSET_DEGREES = 2.0
"""The center of a cloud in degrees is at least this far from 0 in x or y: a local origin lies in or near the object."""
_MIN_POINTS, _POINTS_PER_CELL, _MAX_SAMPLED_POINTS = 30, 4, 20_000
"""Smaller clouds are never converted; the test for ground bins a sample of the points into grid cells."""
_MAX_CELL_HEIGHT_SHARE = 0.4
"""In a cloud of ground the median cell is at most this high, as a share of the height of the whole cloud."""
PROJECTION_ADVICE = "project them to metres for true shapes (pyproj, or PDAL's filters.reprojection)"


@np.errstate(all="ignore")  # the numbers may be no coordinates
def metres_from_degrees(points: np.ndarray) -> tuple[np.ndarray, str]:
    """Converts finite points (N, 3) to metres east, north and up if their x and y look like degrees.

    A cloud in degrees would be a needle in metres: far taller than wide, away from the origin but on the globe, and
    with about one height per position, which ground has and a lamppost has not. In doubt the points stay unchanged and
    the note says so.

    Returns:
        The converted points, or `points` itself; and a note for the user, empty where there is nothing to say.
    """
    if len(points) < _MIN_POINTS or not _are_away_on_globe(points):
        return points, ""
    measured = points[points.any(1)]  # 0 0 0 stands for a missing measurement
    if len(measured) < _MIN_POINTS or not _could_be_degrees(measured):
        return points, ""
    low, high = measured.min(0), measured.max(0)
    ranges = f"({low[0]:g}..{high[0]:g}, {low[1]:g}..{high[1]:g})"
    if (high - low)[2] < _CERTAIN_HEIGHT_TO_WIDTH * (high - low)[:2].max() and not _is_ground(measured):
        return points, f"if x and y {ranges} are degrees, {PROJECTION_ADVICE}"
    note = (f"x and y look like degrees {ranges} beside z in metres, so they are laid out in metres, as longitude and "
            f"latitude; {PROJECTION_ADVICE}")  # fmt: skip
    return _project(points, (low + high) / 2), note


@np.errstate(all="ignore")  # the numbers may be no coordinates
def project_degrees(points: np.ndarray) -> tuple[np.ndarray, str]:
    """Converts points (N, 3) of longitude and latitude in degrees and height in metres to metres east, north and up.

    Returns:
        The converted points and a note for the user; `points` itself and "" if the numbers are no degrees.
    """
    finite = points[np.isfinite(points).all(1)]
    if not len(finite) or np.abs(finite[:, 0]).max() > 360 or np.abs(finite[:, 1]).max() > _MAX_LATITUDE_DEGREES:
        return points, ""
    middle = (finite.min(0) + finite.max(0)) / 2
    return _project(points, middle), f"longitude and latitude are laid out in metres; {PROJECTION_ADVICE}"


def _are_away_on_globe(points: np.ndarray) -> bool:
    """Whether x and y of points (N, 3) are in the range of degrees, and some far from 0: a fast test, before others."""
    low, high = bounding_box(points)
    largest = np.maximum(np.abs(low), np.abs(high))
    return bool(largest[0] <= 180 and largest[1] <= _MAX_LATITUDE_DEGREES and largest[:2].max() >= _MIN_OFFSET_DEGREES)


def _could_be_degrees(points: np.ndarray) -> bool:
    """Whether x and y of points (N, 3) are in the range of degrees, and small beside the heights."""
    low, high = points.min(0), points.max(0)
    wide, middle = (high - low)[:2].max(), np.abs((low + high)[:2] / 2)
    on_globe = np.abs([low[0], high[0]]).max() <= 180 and np.abs([low[1], high[1]]).max() <= _MAX_LATITUDE_DEGREES
    away = middle.max() >= max(_MIN_OFFSET_DEGREES, 2 * wide)
    whole = bool((points[:, :2] == np.floor(points[:, :2])).all())
    slender = (high - low)[2] >= _MIN_HEIGHT_TO_WIDTH * wide
    return bool(on_globe and away and not whole and 0 < wide <= _MAX_SPAN_DEGREES and slender)


def _is_ground(points: np.ndarray) -> bool:
    """Whether points (N, 3) have about one height at each horizontal position."""
    some = points[:: -(-len(points) // _MAX_SAMPLED_POINTS)]
    low, size = some.min(0), np.ptp(some, axis=0)
    if not size[:2].min() > 0:
        return False
    cells = max(int(math.sqrt(len(some) / _POINTS_PER_CELL)), 2)
    column, row = np.minimum((some[:, :2] - low[:2]) / size[:2] * cells, cells - 1).astype(int).T
    cell = row * cells + column
    highest, lowest = np.full(cells**2, -np.inf), np.full(cells**2, np.inf)
    np.maximum.at(highest, cell, some[:, 2])
    np.minimum.at(lowest, cell, some[:, 2])
    taken = np.bincount(cell, minlength=cells**2) > 1
    return bool(taken.any() and np.median((highest - lowest)[taken]) < _MAX_CELL_HEIGHT_SHARE * size[2])


def _project(points: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Equirectangular projection of points (N, 3) about `middle` (3,): degrees to metres."""
    scale = METRES_PER_DEGREE * np.array([math.cos(math.radians(middle[1])), 1.0])
    return np.column_stack([(points[:, :2] - middle[:2]) * scale, points[:, 2]])
