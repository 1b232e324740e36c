"""What the user may want to know or to try of a scan as it stands in its picture."""

from __future__ import annotations

import re

import numpy as np

from z2p_core.linalg import bounding_box, rotate_points
from z2p_core.placement.depth_camera import MILLIMETRES, implied_sensor
from z2p_core.placement.outliers import outlier_sample
from z2p_core.placement.room_detection import is_room
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.surface.subsampling import subsample_uniform
from z2p_core.up_axis.choose import UpChoice

ROOM_HINT = "it looks like a room: --cut-top 40 --elevation 55 shows its inside"
MILLIMETRES_HINT = "if it is a depth camera's in millimetres, --view sensor looks from there"
MIN_POINTS_FOR_STEPS, MAX_STEPS, MIN_STEPPED_WIDTH = 1000, 60, 0.1
"""Of a cloud an axis of which was rounded: its points, the steps at most of that axis along its widest side, and the
width of that axis as a share of that side."""
GRID_SHARE = 0.25
"""Values of an axis for each point, at most, in a grid; and least share of a raster's places that are taken."""
MIN_POINTS_FOR_SHAPE, FEW_HINT = 100, "so few points tell no surface: some hundreds are needed for a shape to show"
SMALL_HINT = "most of its points lie in a small part of the frame: the others may be strays, to be removed first"
MAIN_PART_SHARE, SMALL_PART_RADIUS = 0.85, 0.2
"""Share of the points that is most, and the radius about their middle, in the frame's, that is small."""
TINY_HINT = "it is tiny in this camera's frame, which may be of data in other units"
TINY_RADIUS = 0.1
"""Radius of a whole cloud, in the frame's, that hardly shows."""
FLOOR_ABOVE = "the camera's floor lies above its lowest points: leave floor out for each cloud to stand on its own"
FLOOR_BELOW = "the camera's floor lies far below it: leave floor out for each cloud to stand on its own"
MAX_SUNK_SHARE, MAX_HOVER_RADII = 0.1, 4.0
"""How far a cloud may sink into a settled floor, in its height, and hover above one, in the frame's radii."""
MIN_STEPS_ACROSS = 1000
"""Steps that a cloud spans at least where its numbers are fine enough: fewer show in a picture."""


def scan_hint(points: np.ndarray, up: UpChoice, by_itself: bool, whole: bool) -> str:
    """What the user may want to try or to know of points (N, 3) that stand so, or nothing.

    `by_itself`: z2p chose up and view; `whole`: nothing was cut off.
    """
    if len(points) < MIN_POINTS_FOR_SHAPE:
        return FEW_HINT
    return "; ".join(filter(None, (_other_up(up), _shape_hint(points, up, by_itself, whole))))


def few_points_hint(count: int) -> str:
    """What to say of so few points that each is drawn as a ball."""
    return f"its {count} points are drawn as balls, for {FEW_HINT}"


def _other_up(up: UpChoice) -> str:
    """What to try where another axis may be up."""
    return f"up may be {up.other}: --up {up.other} turns it so" if up.other else ""


def _shape_hint(points: np.ndarray, up: UpChoice, by_itself: bool, whole: bool) -> str:
    """What the shape of points (N, 3) suggests to try, or nothing."""
    upright_points = rotate_points(points, up.rotation)
    if whole and (is_room(upright_points) or is_room(upright_points / MILLIMETRES)):
        return ROOM_HINT
    if by_itself and up.sensor is None and implied_sensor(points, (MILLIMETRES,)):
        return MILLIMETRES_HINT
    return _stepped(points) if up.sensor is None else ""


def small_part_hint(cloud: np.ndarray) -> str:
    """What to say where few of the placed points (N, 3) float32 make the frame wide, and the others hardly fill it."""
    sample = outlier_sample(cloud)
    away = np.sqrt(((sample - np.median(sample, axis=0)) ** 2).sum(1))
    return SMALL_HINT if np.quantile(away, MAIN_PART_SHARE) < SMALL_PART_RADIUS else ""


def fixed_camera_hint(cloud: np.ndarray, viewpoint: Viewpoint) -> str:
    """What to say where a given camera shows next to nothing of placed points (N, 3), or no floor."""
    low, high = bounding_box(cloud)
    tiny = (high - low).max() < 2 * TINY_RADIUS
    floor = low[2] if viewpoint.floor is None else viewpoint.floor
    above = floor > low[2] + MAX_SUNK_SHARE * (high - low)[2]
    away = FLOOR_ABOVE if above else FLOOR_BELOW if floor < low[2] - MAX_HOVER_RADII else ""
    return "; ".join(filter(None, (TINY_HINT if tiny else "", away)))


def options_as_keywords(hint: str) -> str:
    """A hint with its options as keywords: ``--cut-top 40`` becomes ``cut_top=40``."""
    option = re.compile(r"--([a-z-]+) ([+-]?\w+)")
    return option.sub(lambda match: f"{match[1].replace('-', '_')}={_literal(match[2])}", hint)


def float32_step(points: np.ndarray) -> float:
    """Step between the float32 numbers at points (N, 3) that hold nothing finer, if the cloud spans few of them.

    A grid whose own steps are wider has lost nothing, nor has a raster, each place of which comes once.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float32: nothing to say
        low, high = bounding_box(points)
        step = float(np.spacing(np.float32(max(high.max(), -low.min()))))
        if (high - low).max() >= MIN_STEPS_ACROSS * step or not np.array_equal(points, points.astype(np.float32)):
            return 0.0
        rounded = np.spacing(np.maximum(np.abs(low), np.abs(high)).astype(np.float32)) == step
    steps = np.rint((points[:, rounded] - low[rounded]) / step).astype(np.int64)
    wider = bool((np.gcd.reduce(steps) > 1).all())
    return 0.0 if wider or _is_raster(points) else step


def _is_raster(points: np.ndarray) -> bool:
    """Whether points (N, 3) are heights over a grid of places, each of which comes once, and many do."""
    (first, row), (second, column) = (np.unique(points[:, axis], return_inverse=True) for axis in (0, 1))
    once = len(np.unique(row * len(second) + column)) == len(points)
    return bool(once and len(points) >= GRID_SHARE * len(first) * len(second) and min(len(first), len(second)) > 1)


def _literal(word: str) -> str:
    return word if word.isdigit() else repr(word)


def _stepped(points: np.ndarray) -> str:
    """What to say of points (N, 3) of which an axis, but not all, takes few values; or nothing."""
    if len(points) < MIN_POINTS_FOR_STEPS:
        return ""
    some = subsample_uniform(points, MIN_POINTS_FOR_STEPS)
    different = np.array([len(np.unique(some[:, axis])) for axis in range(3)])
    low, high = bounding_box(points)
    width = high - low
    stepped = (width > MIN_STEPPED_WIDTH * width.max()) & (width * MAX_STEPS > different * width.max())
    if not stepped.any() or different.max() < 5 * MAX_STEPS:  # a grid of voxels has steps along all axes
        return ""
    if _is_grid(points, stepped):
        return ""
    axes = " and ".join("xyz"[axis] for axis in np.flatnonzero(stepped))
    return f"few different values of {axes}, as when digits are lost in saving: if so, save more of them"


def _is_grid(points: np.ndarray, stepped: np.ndarray) -> bool:
    """Whether points (N, 3), some axes of which (3,) take few values, lie on a grid, as rasters and slices do.

    On a raster of heights each place comes once, and many do; in a grid of all three axes every value comes often.
    Where digits were lost, places repeat, and the other axes have as many values as points.
    """
    values = [np.unique(points[:, axis], return_inverse=True) for axis in range(3)]
    counts = np.array([len(value) for value, _ in values])
    if (counts <= GRID_SHARE * len(points)).all():
        return True
    first, *second = np.flatnonzero(stepped)
    if len(second) != 1:
        return False
    place = values[first][1] * counts[second[0]] + values[second[0]][1]
    once = len(np.unique(place)) == len(points)
    return bool(once and len(points) >= GRID_SHARE * counts[first] * counts[second[0]])
