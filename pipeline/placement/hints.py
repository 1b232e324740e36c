"""Hints for the user about a placed scan: what may be wrong with it, and which option to try."""

from __future__ import annotations

import re

import numpy as np

from z2p_core.linalg import bounding_box, dot_axis, rotate_points
from z2p_core.placement.depth_camera import MILLIMETRES, implied_sensor
from z2p_core.placement.outliers import outlier_sample
from z2p_core.placement.room_detection import ROOM_HEIGHT_METRES, is_room
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.surface.subsampling import subsample_uniform
from z2p_core.up_axis.choose import UpChoice

ROOM_HINT = "it looks like a room: --cut-top 40 --elevation 55 shows its inside"
MILLIMETRES_HINT = "if it is a depth camera's in millimetres, --view sensor looks from there"
FEW_POINTS_HINT = "so few points tell no surface: some hundreds are needed for a shape to show"
SMALL_PART_HINT = "most of its points lie in a small part of the frame: the others may be strays, to be removed first"
TINY_HINT = "it is tiny in this camera's frame, which may be of data in other units"
HIGH_FLOOR_HINT = "the camera's floor lies above its lowest points: leave floor out for each cloud to stand on its own"
LOW_FLOOR_HINT = "the camera's floor lies far below it: leave floor out for each cloud to stand on its own"

MIN_POINTS_FOR_SHAPE = 100
"""Smallest cloud whose shape is examined."""
MAX_ROOM_SAMPLE = 200_000
"""A larger cloud is judged to be a room by this many of its points."""
MIN_POINTS_FOR_STEPS = 1000
"""Smallest cloud whose axes are tested for rounding, and the number of points that are tested."""
MAX_STEPS = 60
"""Largest number of steps of a rounded axis, for the length of the cloud's widest side."""
MIN_STEPPED_WIDTH = 0.1
"""Smallest width of a rounded axis, as a share of the widest side."""
MAX_GRID_VALUES_PER_POINT = 0.25
"""In a grid, each axis has at most this many distinct values per point."""
MIN_RASTER_OCCUPANCY = 0.25
"""Points cover at least this share of a raster's positions."""
MAIN_PART_SHARE = 0.85
"""Share of the points that lies within `SMALL_PART_RADIUS` if the rest makes the object small."""
SMALL_PART_RADIUS = 0.2
"""Distance from the median point, in the frame's radius."""
TINY_RADIUS = 0.1
"""Radius of a cloud, in the frame's, below which it is hardly visible."""
MAX_SUNK_HEIGHT_SHARE = 0.1
"""Largest depth of a cloud below a given camera's floor, as a share of the cloud's height."""
MAX_HOVER_RADII = 4.0
"""Largest height of a cloud above such a floor, in the frame's radius."""
MIN_STEPS_ACROSS = 1000
"""Smallest number of float32 steps across a cloud at which rounding is invisible in a picture."""


def scan_hint(points: np.ndarray, up: UpChoice, by_itself: bool, whole: bool) -> str:
    """Hints about points (N, 3) with this up axis, joined by semicolons; empty without any.

    Args:
        points: in the file's coordinates.
        up: how they are set upright.
        by_itself: True if z2p chose up axis and view.
        whole: True if the top was not cut off.
    """
    if len(points) < MIN_POINTS_FOR_SHAPE:
        return FEW_POINTS_HINT
    return "; ".join(filter(None, (_other_axis_hint(up), _shape_hint(points, up, by_itself, whole))))


def few_points_hint(count: int) -> str:
    """The hint about `count` points, so few that each is drawn as a ball."""
    return f"its {count} points are drawn as balls, for {FEW_POINTS_HINT}"


def _other_axis_hint(up: UpChoice) -> str:
    """The hint to try another up axis, if one is likely too; else empty."""
    return f"up may be {up.other}: --up {up.other} turns it so" if up.other else ""


def _shape_hint(points: np.ndarray, up: UpChoice, by_itself: bool, whole: bool) -> str:
    """The hint to which the shape of points (N, 3) leads, or an empty one."""
    if whole and np.ptp(dot_axis(points, up.rotation[2])) >= ROOM_HEIGHT_METRES[0]:
        some = points if len(points) <= MAX_ROOM_SAMPLE else subsample_uniform(points, MAX_ROOM_SAMPLE)
        upright_points = rotate_points(some, up.rotation)
        if is_room(upright_points) or is_room(upright_points / MILLIMETRES):
            return ROOM_HINT
    if by_itself and up.sensor is None and implied_sensor(points, (MILLIMETRES,)):
        return MILLIMETRES_HINT
    return _rounding_hint(points) if up.sensor is None else ""


def small_part_hint(cloud: np.ndarray) -> str:
    """The hint if few of the placed points (N, 3) float32 make the frame so wide that the rest is small; else empty."""
    sample = outlier_sample(cloud)
    distance = np.sqrt(((sample - np.median(sample, axis=0)) ** 2).sum(1))
    return SMALL_PART_HINT if np.quantile(distance, MAIN_PART_SHARE) < SMALL_PART_RADIUS else ""


def fixed_camera_hint(cloud: np.ndarray, viewpoint: Viewpoint) -> str:
    """The hint if placed points (N, 3) are tiny in a given camera's frame, or far from its floor; else empty."""
    low, high = bounding_box(cloud)
    tiny = (high - low).max() < 2 * TINY_RADIUS
    floor = low[2] if viewpoint.floor is None else viewpoint.floor
    above = floor > low[2] + MAX_SUNK_HEIGHT_SHARE * (high - low)[2]
    floor_hint = HIGH_FLOOR_HINT if above else LOW_FLOOR_HINT if floor < low[2] - MAX_HOVER_RADII else ""
    return "; ".join(filter(None, (TINY_HINT if tiny else "", floor_hint)))


def options_as_keywords(hint: str) -> str:
    """A hint with its options as Python keywords: ``--cut-top 40`` becomes ``cut_top=40``."""
    option = re.compile(r"--([a-z-]+) ([+-]?\w+)")
    return option.sub(lambda match: f"{match[1].replace('-', '_')}={_literal(match[2])}", hint)


def float32_step(points: np.ndarray) -> float:
    """Spacing of float32 numbers, in the data's units, if points (N, 3) were visibly rounded to it; 0 otherwise.

    A grid with wider steps of its own has lost nothing, nor has a raster, each of whose positions comes once.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float32: not rounded to it
        low, high = bounding_box(points)
        step = float(np.spacing(np.float32(max(high.max(), -low.min()))))
        if (high - low).max() >= MIN_STEPS_ACROSS * step or not np.array_equal(points, points.astype(np.float32)):
            return 0.0
        rounded = np.spacing(np.maximum(np.abs(low), np.abs(high)).astype(np.float32)) == step
    steps = np.rint((points[:, rounded] - low[rounded]) / step).astype(np.int64)
    is_grid = bool((np.gcd.reduce(steps) > 1).all())
    return 0.0 if is_grid or _is_raster(points) else step


def _is_raster(points: np.ndarray) -> bool:
    """Whether points (N, 3) are heights over a grid of (x, y) positions, many of which come, and none twice."""
    (first, row), (second, column) = (np.unique(points[:, axis], return_inverse=True) for axis in (0, 1))
    once = len(np.unique(row * len(second) + column)) == len(points)
    is_occupied = len(points) >= MIN_RASTER_OCCUPANCY * len(first) * len(second)
    return bool(once and is_occupied and min(len(first), len(second)) > 1)


def _literal(word: str) -> str:
    return word if word.isdigit() else repr(word)


def _rounding_hint(points: np.ndarray) -> str:
    """The hint if some axes of points (N, 3), but not all, have few distinct values; else empty."""
    if len(points) < MIN_POINTS_FOR_STEPS:
        return ""
    some = subsample_uniform(points, MIN_POINTS_FOR_STEPS)
    value_counts = np.array([len(np.unique(some[:, axis])) for axis in range(3)])
    low, high = bounding_box(points)
    width = high - low
    stepped = (width > MIN_STEPPED_WIDTH * width.max()) & (width * MAX_STEPS > value_counts * width.max())
    if not stepped.any() or value_counts.max() < 5 * MAX_STEPS:  # a grid of voxels has steps along all axes
        return ""
    if _is_grid(points, stepped):
        return ""
    axes = " and ".join("xyz"[axis] for axis in np.flatnonzero(stepped))
    return f"few different values of {axes}, as when digits are lost in saving: if so, save more of them"


def _is_grid(points: np.ndarray, stepped: np.ndarray) -> bool:
    """Whether points (N, 3) lie on a grid, as rasters and slices do; `stepped` (3,) are the axes with few values.

    On a raster of heights each position comes once, and many do; in a grid of all three axes every value comes often.
    Where digits were lost, positions repeat, and the other axes have as many values as there are points.
    """
    values = [np.unique(points[:, axis], return_inverse=True) for axis in range(3)]
    counts = np.array([len(value) for value, _ in values])
    if (counts <= MAX_GRID_VALUES_PER_POINT * len(points)).all():
        return True
    first, *second = np.flatnonzero(stepped)
    if len(second) != 1:
        return False
    place = values[first][1] * counts[second[0]] + values[second[0]][1]
    once = len(np.unique(place)) == len(points)
    return bool(once and len(points) >= MIN_RASTER_OCCUPANCY * counts[first] * counts[second[0]])
