"""Removes the background behind a depth camera's subject, finds its support plane, and recognizes rooms."""

from __future__ import annotations

import math

import numpy as np

from z2p_core.interfaces import Sensor
from z2p_core.linalg import bounding_box, dot_axis
from z2p_core.placement.outliers import inlier_mask
from z2p_core.placement.point_balls import MIN_SURFACE_POINTS
from z2p_core.surface.subsampling import subsample_uniform

MIN_DEPTH_RATIO = 1.15
"""The background begins at least this many times as far from the sensor as the subject's farthest point."""
MAX_GAP_POINT_SHARE = 0.003
"""Largest share of all points within the gap in depth, and in front of the nearest depth that is considered."""
MIN_SUBJECT_SHARE = 0.1
"""Smallest share of all points that a subject has."""
DEPTH_STEPS = 400
"""Resolution of depth: a factor of `MIN_DEPTH_RATIO` is a fortieth of this many steps."""

PLANE_CANDIDATES = 600
"""Number of planes through three random points that are tested (RANSAC)."""
MAX_PLANE_SAMPLE = 3000
"""Largest number of points that the planes are tested with."""
MIN_PLANE_SAMPLE = 200
"""Smallest number of points in which a plane is searched, and that a subject has."""
MAX_TILT_DEGREES = 65.0
"""Largest angle between the support plane's normal and the camera's own up."""
PLANE_HALF_THICKNESS = 0.01
"""Largest distance of a plane's inliers, in the cloud's diagonal."""
MIN_STANDING_HEIGHT = 0.05
"""Smallest height above a plane of points that stand on it, in the cloud's diagonal."""
MIN_PLANE_SHARE = 0.25
"""Smallest share of the points on the support plane."""
MIN_STANDING_SHARE = 0.01
"""Smallest share of the points above the support plane."""
MAX_BELOW_SHARE = 0.03
"""Largest share of the points below the support plane."""

ROOM_SLAB_SHARE = 0.12
"""Thickness of a room's floor and ceiling, as a share of the height."""
MIN_ROOM_COVERAGE = 0.35
"""Smallest share of the footprint that floor and ceiling each cover."""
MAX_ROOM_MIDDLE_COVERAGE = 0.8
"""Largest share of the footprint that a room's walls and furniture cover half way up."""
ROOM_HEIGHT_METRES = (1.9, 12.0)
"""Range of a room's height."""
MIN_ROOM_BREADTH_METRES = 2.5
"""Smallest narrower side of a room."""


def sensor_depths(points: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Depths (N,) of points (N, 3) along a sensor's axis."""
    return dot_axis(points - sensor.position, sensor.rotation[:, 2])


def remove_background(points: np.ndarray, sensor: Sensor) -> tuple[np.ndarray, int]:
    """Points (M, 3) of a depth camera's subject without outliers, and how many of points (N, 3) lay far behind it."""
    if len(points) < MIN_SURFACE_POINTS:  # a gap in depth between a few points means nothing
        return points, 0
    foreground = foreground_mask(points, sensor)
    background_count = int(len(foreground) - foreground.sum())
    if background_count:
        points = points[foreground]
        points = points[inlier_mask(points)]
    return points, background_count


def foreground_mask(points: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Mask (N,) bool of points (N, 3): False for what lies behind the first wide gap in depth from a depth camera.

    All True when there is no such gap, or too few points before it.
    """
    depth = sensor_depths(points, sensor)
    whole = np.ones(len(points), dtype=bool)
    near = float(np.quantile(depth, MAX_GAP_POINT_SHARE))
    if near <= 0:
        return whole
    # steps that grow with depth, so that the gap is the same number of them everywhere
    steps_per_log = DEPTH_STEPS / 40
    step = np.floor(np.log(np.maximum(depth, near) / near) / math.log(MIN_DEPTH_RATIO) * steps_per_log).astype(np.int64)
    count = np.bincount(step)
    before = np.concatenate([[0], np.cumsum(count)])
    width = DEPTH_STEPS // 40
    for first in range(1, len(count) - width + 1):
        in_gap = before[first + width] - before[first]
        is_subject = before[first] >= max(MIN_SUBJECT_SHARE * len(points), MIN_PLANE_SAMPLE)
        if is_subject and in_gap <= MAX_GAP_POINT_SHARE * len(points):
            behind = before[-1] - before[first + width]
            rim = next((edge for edge in range(first, first + width) if count[edge] == 0), first)
            return step < rim if behind > MAX_GAP_POINT_SHARE * len(points) else whole
    return whole


def support_plane_normal(points: np.ndarray, up: np.ndarray, sensor: Sensor) -> np.ndarray | None:
    """Unit normal (3,) of the table or floor that objects stand on in a depth camera's points (N, 3); None without one.

    `up` (3,) is the camera's own up, which is wrong by as much as it was tilted. The plane holds a quarter of the
    points, leans by less than 65 degrees from that, and nearly all else stands on its upper side, the camera too: the
    front of a box has all else behind it, and a wall leans too much.
    """
    sample = subsample_uniform(points, MAX_PLANE_SAMPLE)
    if len(sample) < MIN_PLANE_SAMPLE:
        return None
    size = float(np.linalg.norm(sample.max(0) - sample.min(0)))
    corner = np.random.default_rng(0).integers(0, len(sample), size=(PLANE_CANDIDATES, 3))  # same for all clouds
    first, second, third = (sample[corner[:, place]] for place in range(3))
    normals = np.cross(second - first, third - first)
    length = np.linalg.norm(normals, axis=1)
    fine = length > 1e-4 * size**2
    normals = normals[fine] / length[fine, None]
    normals *= np.where(normals @ up < 0, -1.0, 1.0)[:, None]
    seen = (normals * (sensor.position - first[fine])).sum(1) > 0
    likely = seen & (normals @ up > math.cos(math.radians(MAX_TILT_DEGREES)))
    normals, through = normals[likely], first[fine][likely]
    if len(normals) == 0:
        return None
    height = normals @ sample.T - (normals * through).sum(1)[:, None]
    within = np.abs(height) < PLANE_HALF_THICKNESS * size
    best = int(within.sum(1).argmax())
    below = (height[best] < -PLANE_HALF_THICKNESS * size).mean()
    above = (height[best] > MIN_STANDING_HEIGHT * size).mean()
    if within[best].mean() < MIN_PLANE_SHARE or above < MIN_STANDING_SHARE or below > MAX_BELOW_SHARE:
        return None
    inside = sample[within[best]]
    normal: np.ndarray = np.linalg.svd(inside - inside.mean(0), full_matrices=False)[2][2]
    return normal if normal @ up > 0 else -normal


def is_room(points: np.ndarray) -> bool:
    """Whether points (N, 3), +Z up, look like a room in metres: a floor and a ceiling, and a person fits between.

    A solid object fills the middle of its height, and a ring has no floor at its centre.
    """
    low, high = bounding_box(points)
    if (high - low)[2] < ROOM_HEIGHT_METRES[0]:  # a fast test, which most objects fail
        return False
    low, high = np.quantile(points, [0.002, 0.998], axis=0)
    breadth, height = float((high - low)[:2].min()), float((high - low)[2])
    lowest, highest = ROOM_HEIGHT_METRES
    if not lowest <= height <= highest or breadth < max(MIN_ROOM_BREADTH_METRES, height / 2):
        return False
    cell = np.clip((points[:, :2] - low[:2]) / (high - low)[:2] * 20, 0, 19.999).astype(np.int64)
    footprint = cell[:, 0] * 20 + cell[:, 1]
    taken = len(np.unique(footprint))
    level = (points[:, 2] - low[2]) / height
    slabs = (level < ROOM_SLAB_SHARE, level > 1 - ROOM_SLAB_SHARE, np.abs(level - 0.5) < ROOM_SLAB_SHARE)
    floor, ceiling, middle = (len(np.unique(footprint[slab])) for slab in slabs)
    centre = np.median(np.unique(cell, axis=0), axis=0)
    central = (np.abs(cell - centre) <= 1.5).all(1).any()
    covered = min(floor, ceiling) >= MIN_ROOM_COVERAGE * taken
    return bool(central) and covered and middle <= MAX_ROOM_MIDDLE_COVERAGE * taken
