"""Turns each point of a very small cloud into a small ball of points: too few points define no surface."""

from __future__ import annotations

import math

import numpy as np

from z2p_core.placement.bounding_sphere import bounding_sphere

MIN_SURFACE_POINTS = 64
"""Smallest cloud that is drawn as a surface."""
POINTS_PER_BALL = 240
"""Points that replace each point."""
MAX_BALL_RADIUS = 0.07
"""Largest radius of a ball, in the cloud's radius."""
MIN_BALL_RADIUS = 0.035
"""Smallest radius of a ball, in the cloud's radius."""
BALL_RADIUS_PER_GAP = 0.4
"""Radius of a ball in the distance to the nearest other point: below 0.5, so that most balls do not touch."""


def points_to_balls(points: np.ndarray) -> np.ndarray:
    """Points (N * `POINTS_PER_BALL`, 3) on balls around points (N, 3), at least two of which differ; all float64."""
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    cloud_radius = bounding_sphere(points).radius
    nearest = np.where(distance > 0, distance, np.inf).min(1)
    gap = float(np.quantile(nearest, 0.25, method="lower"))  # inf where squared distances underflow
    radius = max(MIN_BALL_RADIUS * cloud_radius, min(MAX_BALL_RADIUS * cloud_radius, BALL_RADIUS_PER_GAP * gap))
    return (points[:, None] + radius * _ball()).reshape(-1, 3)


def _ball() -> np.ndarray:
    """`POINTS_PER_BALL` unit vectors on a Fibonacci spiral."""
    height = 1 - (2 * np.arange(POINTS_PER_BALL) + 1) / POINTS_PER_BALL
    angle = np.arange(POINTS_PER_BALL) * math.pi * (3 - math.sqrt(5))
    across = np.sqrt(1 - height**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), height])
