"""Removes the background behind a depth camera's subject: what lies beyond the first wide gap in depth."""

from __future__ import annotations

import math

import numpy as np

from z2p_core.interfaces import Sensor
from z2p_core.linalg import dot_axis
from z2p_core.placement.outliers import inlier_mask
from z2p_core.placement.point_balls import MIN_SURFACE_POINTS

MIN_DEPTH_RATIO = 1.15
"""The background begins at least this many times as far from the sensor as the subject's farthest point."""
MAX_GAP_POINT_SHARE = 0.003
"""Largest share of all points within the gap in depth, and in front of the nearest depth that is considered."""
MIN_SUBJECT_SHARE = 0.1
"""Smallest share of all points that a subject has."""
DEPTH_STEPS = 400
"""Resolution of depth: a factor of `MIN_DEPTH_RATIO` is a fortieth of this many steps."""
MIN_SUBJECT_POINTS = 200
"""Smallest number of points that a subject has."""


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
        is_subject = before[first] >= max(MIN_SUBJECT_SHARE * len(points), MIN_SUBJECT_POINTS)
        if is_subject and in_gap <= MAX_GAP_POINT_SHARE * len(points):
            behind = before[-1] - before[first + width]
            rim = next((edge for edge in range(first, first + width) if count[edge] == 0), first)
            return step < rim if behind > MAX_GAP_POINT_SHARE * len(points) else whole
    return whole
