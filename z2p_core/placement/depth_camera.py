"""Whether a given sensor is a depth camera, and whether a cloud without a sensor looks like a depth camera's."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from z2p_core.interfaces import Sensor
from z2p_core.linalg import rotate_points
from z2p_core.surface.subsampling import subsample_uniform

METRES, MILLIMETRES = 1.0, 1000.0
"""Units per metre, as depth cameras write coordinates."""
MAX_SAMPLE = 20_000
"""A larger cloud is judged by this many of its points."""
SENSOR_CONE_DEGREES = 60.0
"""Half angle of the cone that a depth camera sees; a laser scanner sees all around."""
MIN_SHARE_IN_CONE = 0.98
"""Smallest share of a depth camera's points in that cone."""

MIN_POINTS_IMPLIED = 500
"""Smallest cloud whose depth layers say whether a depth camera took it."""
IMPLIED_CONE_DEGREES = 50.0
"""Half angle of the cone around the Z axis that must hold all points of an implied depth camera's cloud."""
IMPLIED_DEPTHS_METRES = (0.1, 15.0)
"""Range of depths of an implied depth camera's cloud."""
NARROW_CONE_DEGREES = 25.0
"""Half angle of a cone so narrow that hardly any other cloud lies in it by chance."""
MAX_LAYERED_FRONT = 0.05
"""Largest share of directions from the camera that may hold two depths."""
MIN_LAYERED_SIDE = 0.1
"""Smallest share of directions from the side that must hold two depths."""
MIN_LAYERED_SIDE_NARROW = 0.015
"""The same within the narrow cone, so that a shallow relief, such as a face, counts as well."""
LAYERED_SIDE_TO_FRONT = 3
"""How many times as many directions must hold two depths from the side as from the camera."""
POINTS_PER_CELL = 8
"""Points that a cell of the picture holds on average, where layers are counted."""
LAYER_GAP_CELLS = 6
"""A gap in depth wider than this many cells separates two layers: no slope that is sampled all along makes one."""


def is_depth_camera(points: np.ndarray, sensor: Sensor) -> bool:
    """True if nearly all points (N, 3) lie in the cone that a depth camera at the sensor's pose sees."""
    seen = rotate_points(subsample_uniform(points, MAX_SAMPLE) - sensor.position, sensor.rotation.T)
    inside = np.hypot(seen[:, 0], seen[:, 1]) <= math.tan(math.radians(SENSOR_CONE_DEGREES)) * seen[:, 2]
    return bool(inside.mean() > MIN_SHARE_IN_CONE)


def implied_sensor(points: np.ndarray, units: Sequence[float] = (METRES,)) -> Sensor | None:
    """Depth camera at the origin that took points (N, 3), judged by their shape alone; None if it does not look so.

    All points must lie before the origin in a narrow cone along +Z (OpenCV's axes) or -Z (OpenGL's). From the origin
    hardly any direction may hold two depths, while from the side many do: a whole object would show its back as well.
    Hills measured from the air look the same, so depths must also be those of such cameras in one of the `units` per
    metre. A cloud in millimetres looks the same as hills some hundred metres above the sea.
    """
    if len(points) < MIN_POINTS_IMPLIED:
        return None
    sign = 1.0 if points[:, 2].max() > 0 else -1.0
    depth = sign * points[:, 2]
    nearest, farthest = IMPLIED_DEPTHS_METRES
    if not any(nearest * unit <= depth.min() and depth.max() <= farthest * unit for unit in units):
        return None
    off_axis = math.degrees(math.atan(float((np.hypot(points[:, 0], points[:, 1]) / depth).max())))
    if off_axis > IMPLIED_CONE_DEGREES:
        return None
    x, y, z = subsample_uniform(points, MAX_SAMPLE).T
    depth = sign * z
    from_origin = _layered_share(x / depth, y / depth, depth, float(np.median(depth)))
    from_side = max(_layered_share(y, z, x, 1.0), _layered_share(x, z, y, 1.0))
    least = MIN_LAYERED_SIDE_NARROW if off_axis <= NARROW_CONE_DEGREES else MIN_LAYERED_SIDE
    if from_origin > MAX_LAYERED_FRONT or from_side < max(least, LAYERED_SIDE_TO_FRONT * from_origin):
        return None
    return Sensor(np.zeros(3), np.diag([1.0, sign, sign]))


def _layered_share(u: np.ndarray, v: np.ndarray, depth: np.ndarray, scale: float) -> float:
    """Share of the occupied cells of a picture that hold two clearly different depths.

    Pixel coordinates u (N,), v (N,) and depths (N,). `scale` is the length, in units of depth, of one unit of u.
    """
    plane = np.column_stack([u - u.min(), v - v.min()])
    size = math.sqrt(float(plane.max(0).prod()) * POINTS_PER_CELL / len(u))
    for _ in range(2):  # the first round estimates how much of the rectangle is occupied
        if not size > 0:
            return 0.0
        column, row = (plane / size).astype(np.int64).T
        cell = column * (int(row.max()) + 1) + row
        taken = len(np.unique(cell))
        wide = LAYER_GAP_CELLS * size * scale
        size *= math.sqrt(taken * POINTS_PER_CELL / len(u))
    order = np.lexsort((depth, cell))
    gap = (np.diff(depth[order]) > wide) & (np.diff(cell[order]) == 0)
    return len(np.unique(cell[order][1:][gap])) / taken
