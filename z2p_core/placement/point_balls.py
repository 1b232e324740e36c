"""A handful of points, each drawn as a small ball: a surface through so few would be made up."""

from __future__ import annotations

import math

import numpy as np

from z2p_core.placement.bounding_sphere import bounding_sphere

FEWEST_FOR_SURFACE = 64
"""From so many points on a cloud is drawn as a surface."""
POINTS_A_BALL = 240
"""Points that stand for one."""
LARGEST_RADIUS, SMALLEST_RADIUS, GAP_SHARE = 0.07, 0.035, 0.4
"""Radius of a ball: in the cloud's, and of the distance to the nearest other point, so that most balls do not touch."""


def as_balls(points: np.ndarray) -> np.ndarray:
    """The surfaces of balls about points (N, 3), N < `FEWEST_FOR_SURFACE`, at two places at least."""
    away = np.linalg.norm(points[:, None] - points, axis=2)
    reach = bounding_sphere(points).radius
    nearest = np.where(away > 0, away, np.inf).min(1)
    usual = float(np.quantile(nearest, 0.25, method="lower"))  # infinite where squares of distances are too small
    radius = max(SMALLEST_RADIUS * reach, min(LARGEST_RADIUS * reach, GAP_SHARE * usual))
    return (points[:, None] + radius * _ball()).reshape(-1, 3)


def _ball() -> np.ndarray:
    """`POINTS_A_BALL` unit vectors, spread evenly along a spiral."""
    height = 1 - (2 * np.arange(POINTS_A_BALL) + 1) / POINTS_A_BALL
    angle = np.arange(POINTS_A_BALL) * math.pi * (3 - math.sqrt(5))
    across = np.sqrt(1 - height**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), height])
