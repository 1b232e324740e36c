"""Points whose x and y are degrees of longitude and latitude beside heights in metres: told, and laid out in metres."""

from __future__ import annotations

import math

import numpy as np

METRES_A_DEGREE = 111_320.0
"""Of latitude, and of longitude at the equator."""
_LEAST_SLENDERNESS, _SURE_SLENDERNESS = 30.0, 1000.0
"""How many times as tall as wide the numbers of such a cloud are at least; and so tall that nothing else is."""
_WIDEST_DEGREES, _FARTHEST_LATITUDE = 20.0, 85.0
"""Degrees that such a cloud spans at the most, and how near to a pole it may lie."""
_LEAST_DEGREES = 2.0
"""Degrees that such a place has at least in one direction: an object's own origin lies in it or beside it."""
_FEWEST_POINTS, _POINTS_A_CELL, _MOST_SAMPLED = 30, 4, 20_000
_FLAT_SHARE = 0.4
"""How high the points in a small cell may reach, of the whole height, in a cloud that is a piece of ground."""
PROJECTION_ADVICE = "project them to metres for true shapes (pyproj, or PDAL's filters.reprojection)"


@np.errstate(all="ignore")  # of numbers that are no coordinates
def local_metres(points: np.ndarray) -> tuple[np.ndarray, str]:
    """Finite points (N, 3) in metres east, north and up, if theirs look like degrees, else as they are; and a word.

    Degrees are told by a cloud that would be a needle: far taller than wide, at a place of the globe that is not an
    object's own origin, and with about one height at a place, as ground has and a lamppost has not. In doubt nothing is
    changed but told.
    """
    seen = points[points.any(1)]  # 0 0 0 stands for what was not measured
    if len(seen) < _FEWEST_POINTS or not _could_be(seen):
        return points, ""
    low, high = seen.min(0), seen.max(0)
    ranges = f"({low[0]:g}..{high[0]:g}, {low[1]:g}..{high[1]:g})"
    if (high - low)[2] < _SURE_SLENDERNESS * (high - low)[:2].max() and not _is_ground(seen):
        return points, f"if x and y {ranges} are degrees, {PROJECTION_ADVICE}"
    told = (f"x and y look like degrees {ranges} beside z in metres, so they are laid out in metres, as longitude and "
            f"latitude; {PROJECTION_ADVICE}")  # fmt: skip
    return _laid_out(points, (low + high) / 2), told


@np.errstate(all="ignore")  # of numbers that are no coordinates
def metres_of_degrees(points: np.ndarray) -> tuple[np.ndarray, str]:
    """Points (N, 3), named longitude, latitude and height, in metres east, north and up, and what to say of it.

    Numbers beyond the globe's are left as they are.
    """
    finite = points[np.isfinite(points).all(1)]
    if not len(finite) or np.abs(finite[:, 0]).max() > 360 or np.abs(finite[:, 1]).max() > _FARTHEST_LATITUDE:
        return points, ""
    middle = (finite.min(0) + finite.max(0)) / 2
    return _laid_out(points, middle), f"longitude and latitude are laid out in metres; {PROJECTION_ADVICE}"


def _could_be(points: np.ndarray) -> bool:
    """Whether the numbers of points (N, 3) are those of degrees and of heights that dwarf them."""
    low, high = points.min(0), points.max(0)
    wide, middle = (high - low)[:2].max(), np.abs((low + high)[:2] / 2)
    on_globe = np.abs([low[0], high[0]]).max() <= 180 and np.abs([low[1], high[1]]).max() <= _FARTHEST_LATITUDE
    away = middle.max() >= max(_LEAST_DEGREES, 2 * wide)
    whole = bool((points[:, :2] == np.floor(points[:, :2])).all())
    slender = (high - low)[2] >= _LEAST_SLENDERNESS * wide
    return bool(on_globe and away and not whole and 0 < wide <= _WIDEST_DEGREES and slender)


def _is_ground(points: np.ndarray) -> bool:
    """Whether points (N, 3) have about one height at each place, seen from above."""
    some = points[:: -(-len(points) // _MOST_SAMPLED)]
    low, size = some.min(0), np.ptp(some, axis=0)
    if not size[:2].min() > 0:
        return False
    cells = max(int(math.sqrt(len(some) / _POINTS_A_CELL)), 2)
    column, row = np.minimum((some[:, :2] - low[:2]) / size[:2] * cells, cells - 1).astype(int).T
    cell = row * cells + column
    highest, lowest = np.full(cells**2, -np.inf), np.full(cells**2, np.inf)
    np.maximum.at(highest, cell, some[:, 2])
    np.minimum.at(lowest, cell, some[:, 2])
    taken = np.bincount(cell, minlength=cells**2) > 1
    return bool(taken.any() and np.median((highest - lowest)[taken]) < _FLAT_SHARE * size[2])


def _laid_out(points: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Points (N, 3) of degrees about their middle (3,), equirectangular at its latitude."""
    scale = METRES_A_DEGREE * np.array([math.cos(math.radians(middle[1])), 1.0])
    return np.column_stack([(points[:, :2] - middle[:2]) * scale, points[:, 2]])
