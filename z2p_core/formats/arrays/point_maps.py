"""Where the camera stood that saw a point map, a point for each of its pixels: told by the points alone."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Sensor

_MAX_SAMPLED_LINES = 64
"""Rows and columns of a map that are looked at."""
_MIN_POINTS = 60
"""Points that tell a camera, at least."""
_MAX_RAY_ERROR_SHARE = 0.1
"""How far the rays of a pinhole camera may be off, of how far they spread."""
_MAX_PIXEL_ERROR = 0.02
"""The same for a camera anywhere, whose pixels are reckoned from its points."""
_MIN_AHEAD_SHARE = 0.98
"""Share of the points that lie ahead of their camera, at least."""
_MIN_UPRIGHT_COSINE = 0.995
"""Cosine from which on a camera's picture stands upright in the camera's own axes."""


@np.errstate(all="ignore")  # of numbers that are no coordinates
def estimate_map_sensor(points: np.ndarray, certain: bool = False) -> Sensor | None:
    """The camera that saw points (H, W, 3), row by row from the top of its picture; None where they do not tell.

    In the camera's own axes, OpenCV's (+Z ahead), OpenGL's (-Z ahead) or turned ones, it stands at the origin, and the
    pixels tell which way is right and down. In other axes it is where the lines of sight meet. `certain`: it is a map
    in the camera's axes by its name, so that one whose rays are crooked is believed as well, if all lies ahead.
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
    except np.linalg.LinAlgError:  # numbers too large to be reckoned with
        return None


def _camera_at_origin(points: np.ndarray, pixels: np.ndarray) -> Sensor | None:
    """The camera at the origin that looks along Z, if each pixel (N, 2) has its ray."""
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
    """The camera anywhere whose picture has points (N, 3) at their pixels (N, 2), by direct linear transformation."""
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
    """The camera at the origin in OpenCV's or OpenGL's axes, if all lies ahead of it."""
    sign = _sign_of_z(points)
    return Sensor(np.zeros(3), np.diag([1.0, sign, sign])) if sign else None


def _sign_of_z(points: np.ndarray) -> float:
    """1.0 where points (N, 3) lie on the side of +Z, -1.0 on that of -Z, and 0.0 on both."""
    if (points[:, 2] > 0).mean() > _MIN_AHEAD_SHARE:
        return 1.0
    return -1.0 if (points[:, 2] < 0).mean() > _MIN_AHEAD_SHARE else 0.0


def _sensor_facing(position: np.ndarray, right: np.ndarray, downward: np.ndarray, ahead: np.ndarray) -> Sensor | None:
    """The sensor there that looks so, upright as its picture is; in a mirrored file, left and right are exchanged."""
    downward = downward - (downward @ ahead) * ahead
    length = float(np.linalg.norm(downward))
    if not length > 0 or not np.linalg.norm(right) > 0:
        return None
    downward = downward / length
    return Sensor(position, np.column_stack([np.cross(downward, ahead), downward, ahead]))
