"""Estimates the camera pose of a point map, which has one point per pixel, from its points alone."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Sensor

_MAX_SAMPLED_LINES = 64
"""Rows and columns of a map that are examined."""
_MIN_POINTS = 60
"""Least number of valid points for an estimate."""
_MAX_RAY_ERROR_SHARE = 0.1
"""RMS error of the rays of a pinhole camera at the origin, as a share of their standard deviation."""
_MAX_PIXEL_ERROR = 0.02
"""RMS reprojection error of a camera at any position, in units of the image side."""
_MIN_AHEAD_SHARE = 0.98
"""Least share of the points that lie in front of their camera."""
_MIN_UPRIGHT_COSINE = 0.995
"""From this cosine between the image's down direction and an axis on, the image is taken as aligned with that axis."""


@np.errstate(all="ignore")  # the numbers may be no coordinates
def estimate_map_sensor(points: np.ndarray, certain: bool = False) -> Sensor | None:
    """Estimates the pose of the camera of a point map (H, W, 3), whose rows run from the top of the image.

    In camera axes (OpenCV's, +Z ahead, OpenGL's, -Z ahead, or rotated ones) the camera is at the origin, and the pixels
    determine right and down. In other axes its pose follows from a direct linear transformation.

    Args:
        certain: the map is in camera axes by its name; then points in front of the origin suffice.

    Returns:
        None if the points do not determine a camera.
    """
    rows, columns = (np.linspace(0, side - 1, min(side, _MAX_SAMPLED_LINES)).astype(int) for side in points.shape[:2])
    across, down = np.meshgrid(columns / points.shape[1] - 0.5, rows / points.shape[0] - 0.5)
    some = points[rows[:, None], columns].astype(np.float64).reshape(-1, 3)
    valid = np.isfinite(some).all(1) & some.any(1)
    some, pixels = some[valid], np.column_stack([across.ravel()[valid], down.ravel()[valid]])
    if len(some) < _MIN_POINTS:
        return None
    try:
        sensor = _camera_at_origin(some, pixels) or _camera_by_dlt(some, pixels)
        return sensor or (_camera_by_name(some) if certain else None)
    except np.linalg.LinAlgError:  # the numbers are too large
        return None


def _camera_at_origin(points: np.ndarray, pixels: np.ndarray) -> Sensor | None:
    """The camera at the origin that looks along Z, if the rays are an affine function of the pixels (N, 2)."""
    sign = _sign_of_z(points)
    if sign == 0:
        return None
    rays = points[:, :2] / np.abs(points[:, 2:])
    design = np.column_stack([pixels, np.ones(len(pixels))])
    slopes, *_ = np.linalg.lstsq(design, rays, rcond=None)
    residuals = rays - design @ slopes
    if (residuals**2).mean(0).max() > (_MAX_RAY_ERROR_SHARE**2) * rays.var(0).min() or not rays.var(0).all():
        return None
    ahead = np.array([0.0, 0.0, sign])
    downward = np.array([*slopes[1], 0.0])
    if np.abs(downward).max() > _MIN_UPRIGHT_COSINE * np.linalg.norm(downward):  # along an axis, but for noise
        downward = np.where(np.abs(downward) == np.abs(downward).max(), downward, 0.0)
    return _sensor_facing(np.zeros(3), np.array([*slopes[0], 0.0]), downward, ahead)


def _camera_by_dlt(points: np.ndarray, pixels: np.ndarray) -> Sensor | None:
    """The camera at any position that projects points (N, 3) to pixels (N, 2), by direct linear transformation."""
    middle = np.median(points, axis=0)
    scale = float(np.abs(points - middle).mean())
    if not 0 < scale < np.inf:
        return None
    near = np.column_stack([(points - middle) / scale, np.ones(len(points))])
    zero = np.zeros_like(near)
    rows = np.vstack([np.hstack([near, zero, -pixels[:, :1] * near]), np.hstack([zero, near, -pixels[:, 1:] * near])])
    weights, vectors = np.linalg.eigh(rows.T @ rows)
    if not weights[1] > 10 * max(weights[0], 1e-12 * weights[-1]):  # flat: many cameras would do
        return None
    matrix = vectors[:, 0].reshape(3, 4)
    valid = near @ matrix.T
    if abs(np.linalg.det(matrix[:, :3])) < 1e-9 or not (np.abs(valid[:, 2]) > 1e-12).all():
        return None
    residuals = valid[:, :2] / valid[:, 2:] - pixels
    on_one_side = max((valid[:, 2] > 0).mean(), (valid[:, 2] < 0).mean())
    if np.sqrt((residuals**2).mean()) > _MAX_PIXEL_ERROR or on_one_side < _MIN_AHEAD_SHARE:
        return None
    matrix *= np.sign(np.median(valid[:, 2]))
    position = middle - scale * np.linalg.solve(matrix[:, :3], matrix[:, 3])
    ahead = matrix[2, :3] / np.linalg.norm(matrix[2, :3])
    right, downward = (row - (row @ ahead) * ahead for row in matrix[:2, :3])
    return _sensor_facing(position, right, downward, ahead)


def _camera_by_name(points: np.ndarray) -> Sensor | None:
    """The camera at the origin in OpenCV's or OpenGL's axes, if the points lie in front of it."""
    sign = _sign_of_z(points)
    return Sensor(np.zeros(3), np.diag([1.0, sign, sign])) if sign else None


def _sign_of_z(points: np.ndarray) -> float:
    """1.0 if points (N, 3) have positive z, -1.0 if they have negative z, 0.0 if they have both."""
    if (points[:, 2] > 0).mean() > _MIN_AHEAD_SHARE:
        return 1.0
    return -1.0 if (points[:, 2] < 0).mean() > _MIN_AHEAD_SHARE else 0.0


def _sensor_facing(position: np.ndarray, right: np.ndarray, downward: np.ndarray, ahead: np.ndarray) -> Sensor | None:
    """The sensor at `position` that looks along `ahead`, with the image's down direction; right-handed in any case."""
    downward = downward - (downward @ ahead) * ahead
    length = float(np.linalg.norm(downward))
    if not length > 0 or not np.linalg.norm(right) > 0:
        return None
    downward = downward / length
    return Sensor(position, np.column_stack([np.cross(downward, ahead), downward, ahead]))
