"""A user's camera in the data's own units: pinhole with K, R, t, or orthographic; and cameras that look at a point.

Camera axes are OpenCV's: +X right, +Y down, +Z forward; R and t go from the data's axes to the camera's. Pixel (column
i, row j) covers [i, i + 1) x [j, j + 1), as in COLMAP: the principal point of a centered camera is half its size. To K
of OpenCV's calibration, where pixel 0 is centered on 0, add 0.5.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from z2p_core.errors.value_limits import describe_value
from z2p_core.interfaces import SettingError
from z2p_core.linalg import rotate_points
from z2p_core.scene import SIDE_LIMITS

PINHOLE_JSON_VERSION = 1
"""Version of the JSON format, raised when its meaning changes."""
ROTATION_TOLERANCE = 1e-4
"""Largest deviation of a given rotation's rows from unit length and right angles."""
MAX_NUMBER = 1e150
"""Largest coordinate, whose square does not overflow."""
MM_PER_INCH = 25.4
DEFAULT_FIELD_OF_VIEW = 40.0
"""Angle across the shorter side, in degrees."""

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]


@dataclass(frozen=True)
class PinholeCamera:
    """A camera with square or oblong pixels and without lens distortion, in the data's units."""

    width: int
    """In pixels."""
    height: int
    focal: tuple[float, float]
    """Focal lengths along x and y in pixels; of an orthographic camera, pixels for each unit of the data."""
    center: tuple[float, float]
    """Principal point in pixels."""
    rotation: Matrix
    """R, rows: the camera's right, down and forward axis in the data's axes."""
    translation: Vector
    """t: a point p of the data lies at R p + t in the camera's axes."""
    orthographic: bool = False
    """Whether rays are parallel: pixels are ``focal * (R p + t)[:2] + center``, whatever the depth."""
    name: str = ""
    """Of its image, as pose files have one."""

    @property
    def intrinsics(self) -> np.ndarray:
        """K (3, 3) float64."""
        (fx, fy), (cx, cy) = self.focal, self.center
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def position(self) -> np.ndarray:
        """Its center (3,) float64 in the data's coordinates."""
        position: np.ndarray = -np.array(self.rotation).T @ np.array(self.translation)
        return position

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixel coordinates (N, 2), x right and y down, and depths (N,) along the optical axis, of points (N, 3)."""
        in_camera = rotate_points(np.asarray(points, np.float64), np.array(self.rotation)) + np.array(self.translation)
        depth = in_camera[:, 2]
        flat = in_camera[:, :2] if self.orthographic else in_camera[:, :2] / depth[:, None]
        return flat * np.array(self.focal) + np.array(self.center), depth

    def unproject(self, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Points (N, 3) float64 of the data at pixel coordinates (N, 2) and depths (N,); the inverse of `project`."""
        flat = (np.asarray(pixels, np.float64) - np.array(self.center)) / np.array(self.focal)
        flat = flat if self.orthographic else flat * depth[:, None]
        in_camera = np.column_stack([flat, depth]) - np.array(self.translation)
        points: np.ndarray = rotate_points(in_camera, np.array(self.rotation).T)
        return points

    def resized(self, width: int, height: int) -> PinholeCamera:
        """The same view with another number of pixels."""
        across, down = width / self.width, height / self.height
        return replace(self, width=width, height=height, focal=(self.focal[0] * across, self.focal[1] * down),
                       center=(self.center[0] * across, self.center[1] * down))  # fmt: skip

    def fitted(self, width: int, height: int) -> PinholeCamera:
        """The same view in the largest picture of the same shape within so many pixels."""
        scale = min(width / self.width, height / self.height)
        return self.resized(max(1, round(self.width * scale)), max(1, round(self.height * scale)))

    def to_json(self) -> dict[str, Any]:
        """The camera as plain numbers, with names for its axes and units, for `camera_from_json`."""
        return {
            "z2p_pinhole": PINHOLE_JSON_VERSION,
            "model": "orthographic" if self.orthographic else "pinhole",
            "width": self.width,
            "height": self.height,
            "K": self.intrinsics.tolist(),
            "R": [list(row) for row in self.rotation],
            "t": list(self.translation),
            "axes": "OpenCV: x right, y down, z forward; R and t from the data to the camera",
            "units": "of the data",
            **({"name": self.name} if self.name else {}),
        }


@dataclass(frozen=True)
class LookAt:
    """A camera that stands at a point and looks at another, or in a direction at the cloud, upright in the picture."""

    eye: Vector | None = None
    """Where it stands, in the data's coordinates; None: in the direction of the view, orthographic only."""
    target: Vector | None = None
    """What it looks at; None: the middle of the cloud."""
    up: Vector | None = None
    """What is up in the picture; None: what is up in the data."""
    field_of_view: float = DEFAULT_FIELD_OF_VIEW
    """Angle across the shorter side of the picture, in degrees."""
    pixels_per_unit: float | None = None
    """Pixels for each unit of the data: the camera is orthographic; None: it is a pinhole camera."""
    size: tuple[int, int] | None = None
    """Of the picture, in pixels; None: an orthographic camera's follows from the cloud."""

    def to_json(self) -> dict[str, Any]:
        """The wish as plain numbers, which a record keeps."""
        return {
            "eye": None if self.eye is None else list(self.eye),
            "target": None if self.target is None else list(self.target),
            "up": None if self.up is None else list(self.up),
            "field_of_view": self.field_of_view,
            "pixels_per_unit": self.pixels_per_unit,
        }


AnyCamera = PinholeCamera | LookAt


def pinhole_camera(
    K: Any, R: Any, t: Any, size: Sequence[int], *, orthographic: bool = False, name: str = ""
) -> PinholeCamera:
    """The camera with intrinsics K (3, 3), and rotation R (3, 3) and translation t (3,) from the data to the camera.

    Args:
        K: focal lengths and principal point in pixels, without skew; orthographic: pixels per unit of the data.
        R: rows: the camera's right, down and forward axis (OpenCV).
        t: R p + t is the point p of the data in the camera's axes.
        size: width and height in pixels.
        orthographic: whether rays are parallel.
        name: what pictures are named after.

    Raises:
        SettingError: an argument is no such matrix, vector or size.
    """
    intrinsics, rotation, translation = _numbers(K, "K", (3, 3)), _numbers(R, "R", (3, 3)), _numbers(t, "t", (3,))
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise SettingError(
            "camera: expected R as a rotation matrix (rows of length 1 at right angles, no mirror), got "
            f"{rotation.tolist()}"
        )
    if abs(intrinsics[0, 1]) > 1e-6 * abs(intrinsics[0, 0]) or np.abs(intrinsics[2] - (0, 0, 1)).max() > 1e-6:
        raise SettingError(f"camera: expected K as [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {intrinsics.tolist()}")
    if not (intrinsics[0, 0] > 0 and intrinsics[1, 1] > 0):
        raise SettingError(f"camera: expected focal lengths above 0, got {intrinsics[0, 0]:g}, {intrinsics[1, 1]:g}")
    width, height = _size(size)
    u, _, v = np.linalg.svd(rotation)
    rows = cast(Matrix, tuple(tuple(row) for row in (u @ v).tolist()))  # the digits of files are few
    x, y, z = translation.tolist()
    return PinholeCamera(
        width, height, (float(intrinsics[0, 0]), float(intrinsics[1, 1])),
        (float(intrinsics[0, 2]), float(intrinsics[1, 2])), rows, (x, y, z), bool(orthographic), str(name),
    )  # fmt: skip


def look_at_camera(wish: LookAt, size: tuple[int, int], middle: Any, upward: Any) -> PinholeCamera:
    """The camera that a `LookAt` stands for, for a cloud with that middle (3,), in data whose up is `upward` (3,).

    Raises:
        SettingError: it would stand where it looks.
    """
    target = np.array(middle if wish.target is None else wish.target, np.float64)
    if wish.eye is None:
        raise SettingError("camera: expected where it stands (look-from)")
    up = np.array(upward if wish.up is None else wish.up, np.float64)
    return aimed_camera(np.array(wish.eye, np.float64), target, up, size, wish.field_of_view, wish.pixels_per_unit)


def aimed_camera(
    eye: np.ndarray, target: np.ndarray, up: np.ndarray, size: tuple[int, int], field_of_view: float,
    pixels_per_unit: float | None,
) -> PinholeCamera:  # fmt: skip
    """The camera at `eye` (3,) that looks at `target` (3,) with `up` (3,) as far up in the picture as can be.

    Straight down or up, where `up` says nothing, what is farthest along the first other axis is up.

    Raises:
        SettingError: both points are the same, or `up` is 0.
    """
    forward = target - eye
    distance, length = float(np.linalg.norm(forward)), float(np.linalg.norm(up))
    if not distance > 1e-12 * max(1.0, float(np.abs(eye).max())):
        raise SettingError(f"camera: expected it to look at another point than it stands at, got {eye.tolist()} twice")
    if not length > 0:
        raise SettingError("camera: expected a direction as up, got 0,0,0")
    forward, up = forward / distance, up / length
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-6:
        away = np.roll(up, 2) if abs(up[2]) > 0.5 else np.roll(up, 1)  # +Y for +Z, as on maps; +Z for +Y
        right = np.cross(forward, away - (away @ forward) * forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    width, height = size
    focal = pixels_per_unit or min(width, height) / 2 / math.tan(math.radians(field_of_view / 2))
    rows = cast(Matrix, tuple(tuple(row) for row in rotation.tolist()))
    x, y, z = (-rotation @ eye).tolist()
    return PinholeCamera(width, height, (focal, focal), (width / 2, height / 2), rows, (x, y, z),
                         pixels_per_unit is not None)  # fmt: skip


def look_at(
    eye: Any, target: Any = None, up: Any = None, fov: float = DEFAULT_FIELD_OF_VIEW,
    pixels_per_unit: float | None = None,
) -> LookAt:  # fmt: skip
    """A camera for `z2p_core.render`, in the data's coordinates: at `eye` (3,), looking at `target` (3,).

    Args:
        eye: where it stands.
        target: what it looks at; None: the middle of the cloud.
        up: what is up in the picture; None: what is up in the data.
        fov: angle across the shorter side, in degrees.
        pixels_per_unit: makes it orthographic, with so many pixels for each unit of the data.

    Raises:
        SettingError: an argument is no such vector or number.
    """
    if not 1 <= float(_numbers(fov, "fov", ())) <= 170:
        raise SettingError(f"camera: expected a field of view from 1 to 170 degrees, got {fov!r}")
    if pixels_per_unit is not None and not float(_numbers(pixels_per_unit, "pixels_per_unit", ())) > 0:
        raise SettingError(f"camera: expected pixels_per_unit above 0, got {pixels_per_unit!r}")
    points = [None if point is None else _vector(point, name)
              for name, point in (("look-from", eye), ("look-at", target), ("up", up))]  # fmt: skip
    return LookAt(points[0], points[1], points[2], float(fov), pixels_per_unit)


def pixels_per_unit(mm_per_unit: float, dpi: float) -> float:
    """Pixels for each unit of the data in a picture that is printed at `dpi` and shows a unit so many mm long."""
    return mm_per_unit / MM_PER_INCH * dpi


def camera_from_json(data: Any) -> PinholeCamera:
    """The camera that `PinholeCamera.to_json` described; only K, R, t and the size are needed.

    Raises:
        SettingError: a number is missing or no number, or there is no such camera.
    """
    missing = [key for key in ("K", "R", "t", "width", "height") if not (isinstance(data, Mapping) and key in data)]
    if missing:
        raise SettingError(f"camera: expected an object with K, R, t, width and height, got {describe_value(data)}")
    model, name = data.get("model", "pinhole"), data.get("name", "")
    if model not in ("pinhole", "orthographic"):
        raise SettingError(f"camera: expected the model pinhole or orthographic, got {describe_value(model)}")
    if not isinstance(name, str):
        raise SettingError(f"camera: expected a text as its name, got {describe_value(name)}")
    return pinhole_camera(data["K"], data["R"], data["t"], (data["width"], data["height"]),
                          orthographic=model == "orthographic", name=name)  # fmt: skip


def _vector(given: Any, name: str) -> Vector:
    x, y, z = _numbers(given, name, (3,)).tolist()
    return x, y, z


def _size(size: Any) -> tuple[int, int]:
    """Raises SettingError unless it is a width and a height in whole pixels."""
    try:
        width, height = size
        whole = not isinstance(width, bool) and int(width) == width and int(height) == height
    except (TypeError, ValueError, OverflowError):
        whole, width, height = False, 0, 0
    if not (whole and 1 <= width <= 1 << 16 and 1 <= height <= 1 << 16):
        raise SettingError(f"camera: expected a width and a height in pixels, got {describe_value(size)}")
    return int(width), int(height)


def check_drawable_size(camera: PinholeCamera) -> None:
    """
    Raises:
        SettingError: the camera's picture is larger or smaller than pictures can be.
    """
    least, most = SIDE_LIMITS
    if not (least <= camera.width <= most and least <= camera.height <= most):
        raise SettingError(
            f"camera: expected a picture with sides from {least} to {most} pixels, got {camera.width} x "
            f"{camera.height}; --resolution draws the same view in fewer"
        )


def _numbers(given: Any, key: str, shape: tuple[int, ...]) -> np.ndarray:
    """Float64 array of `shape`, each number up to `MAX_NUMBER`."""
    try:
        array = np.array(given)
    except (TypeError, ValueError, OverflowError, RecursionError):
        array = np.empty(0)
    if array.shape == (3, 1) and shape == (3,):
        array = array[:, 0]
    numbers = array.dtype.kind in "iuf" and array.shape == shape
    if not numbers or not (np.abs(array.astype(np.float64)) < MAX_NUMBER).all():
        kind = "x".join(str(side) for side in shape) + " numbers" if shape else "a number"
        raise SettingError(f"camera: expected {kind} as {key}, got {describe_value(given)}")
    return array.astype(np.float64)
