"""One camera for many clouds: how the data's coordinates become the world that the camera looks at.

A point p of the data stands at ``rotation @ (p - centre) / radius`` in the world of `z2p_core.camera`: +Z up, the
camera on the -Y side at `DISTANCE`, `elevation` degrees above the horizon, looking at the origin. Clouds seen from one
viewpoint therefore keep their true sizes and places beside each other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from z2p_core.camera import DISTANCE, FIELD_OF_VIEW
from z2p_core.errors.value_limits import describe_value
from z2p_core.interfaces import ScanError, SettingError
from z2p_core.linalg import CHUNK_POINTS, rotate_points
from z2p_core.placement.framing_sphere import framing_sphere
from z2p_core.placement.zoom import UNZOOMED, Zoom, parse_zoom

JSON_VERSION = 1
"""Version of the JSON format, raised when its meaning changes."""
MIN_LENGTH = 1e-150
"""Smallest length whose square does not underflow."""
MAX_LENGTH = 1e150
"""Largest length whose square does not overflow."""
ROTATION_TOLERANCE = 1e-6
"""Largest deviation of a loaded rotation's rows from unit length and right angles."""


@dataclass(frozen=True)
class Viewpoint:
    """Position, scale and rotation of the data before the camera, and the camera's elevation."""

    centre: tuple[float, float, float]
    """Point of the data at the middle of the picture, in the data's units."""
    radius: float
    """Length in the data's units that is 1 in the world: the sphere that fits the picture."""
    rotation: tuple[tuple[float, ...], ...]
    """Matrix (3, 3), rows, from the data's axes to the world's."""
    elevation: float
    """Elevation of the camera above the horizon, in degrees."""
    floor: float | None = None
    """Height of the floor in world units, for clouds that share one; None: each stands on its own lowest point."""
    zoom: Zoom = UNZOOMED
    """The part of the frame that the picture shows."""

    def place(self, points: np.ndarray) -> np.ndarray:
        """Cloud (N, 3) float32 in world units of points (N, 3) in the data's; float64 inside, so UTM keeps digits."""
        world, rotation = np.empty(points.shape, np.float32), np.array(self.rotation)
        for start in range(0, len(points), CHUNK_POINTS):  # float64 of very many points would take much memory
            placed = points[start : start + CHUNK_POINTS].astype(np.float64)
            placed -= self.centre
            placed /= self.radius
            world[start : start + CHUNK_POINTS] = rotate_points(placed, rotation)
        return world

    def unplace(self, cloud: np.ndarray) -> np.ndarray:
        """Points (N, 3) float64 in the data's units of a cloud (N, 3) in world units; the inverse of `place`."""
        turned = rotate_points(cloud.astype(np.float64), np.array(self.rotation).T)
        points: np.ndarray = turned * self.radius + self.centre
        return points

    def to_json(self) -> dict[str, Any]:
        """The viewpoint as plain numbers, with the constants of the camera that it holds for."""
        return {
            "z2p_camera": JSON_VERSION,
            "centre": list(self.centre),
            "radius": self.radius,
            "rotation": [list(row) for row in self.rotation],
            "elevation": self.elevation,
            "floor": self.floor,
            "distance": DISTANCE,
            "field_of_view": FIELD_OF_VIEW,
            **self.zoom.to_json(),
        }


def frame_points(points: np.ndarray, rotation: np.ndarray, elevation: float) -> Viewpoint:
    """The viewpoint that fits the bounding sphere of points (N, 3) float64, finite, in any unit.

    `rotation` (3, 3) goes from the data's axes to the world's.

    Raises:
        ScanError: there is no extent to scale: no points, or all in one place.
    """
    if len(points) == 0:
        raise ScanError("expected points, got none; check the file")
    sphere = framing_sphere(points)
    if not MIN_LENGTH < sphere.radius < MAX_LENGTH:
        raise ScanError(f"expected points that span a finite volume, got {len(points)} within radius {sphere.radius:g}")
    return Viewpoint(sphere.centre, sphere.radius, tuple(tuple(row) for row in rotation.tolist()), elevation)


def viewpoint_from_json(data: Any) -> Viewpoint:
    """The viewpoint that `Viewpoint.to_json` described.

    Raises:
        SettingError: a number is missing or no number, the rotation is none, or it is for another camera.
    """
    if not isinstance(data, Mapping) or type(data.get("z2p_camera")) is not int or data["z2p_camera"] != JSON_VERSION:
        raise SettingError(f"camera: expected an object with z2p_camera {JSON_VERSION}, got {describe_value(data)}; "
                           "write one with --save-camera")
    centre, radius = _numbers(data, "centre", (3,)), float(_numbers(data, "radius", ()))
    rotation, elevation = _numbers(data, "rotation", (3, 3)), float(_numbers(data, "elevation", ()))
    if not MIN_LENGTH < radius < MAX_LENGTH:
        raise SettingError(f"camera: expected a radius above 0, got {radius:g}")
    if not -90 <= elevation <= 90:
        raise SettingError(f"camera: expected an elevation from -90 to 90 degrees, got {elevation:g}")
    square = np.abs(rotation @ rotation.T - np.eye(3)).max() <= ROTATION_TOLERANCE and np.linalg.det(rotation) > 0
    if not square:
        raise SettingError("camera: expected a rotation matrix (rows of length 1 at right angles, no mirror), got "
                           f"{rotation.tolist()}")
    for key, ours in (("distance", DISTANCE), ("field_of_view", FIELD_OF_VIEW)):
        theirs = float(_numbers(data, key, ())) if key in data else ours
        if not math.isclose(theirs, ours, rel_tol=1e-6):
            raise SettingError(f"camera: the weights know only {key} {ours:g}, got {theirs:g}; move the object by "
                               "centre and radius instead")
    floor = None if data.get("floor") is None else float(_numbers(data, "floor", ()))
    x, y, z = centre.tolist()
    zoom = parse_zoom(data.get("zoom"), data.get("pan"))
    return Viewpoint((x, y, z), radius, tuple(tuple(row) for row in rotation.tolist()), elevation, floor, zoom)


def _numbers(data: Mapping[str, Any], key: str, shape: tuple[int, ...]) -> np.ndarray:
    """Float64 array of `shape` under a key, each number up to `MAX_LENGTH`."""
    try:
        given = np.array(data.get(key))
    except (TypeError, ValueError, OverflowError, RecursionError):
        given = np.empty(0)
    numbers = given.dtype.kind in "iuf" and given.shape == shape  # no texts, booleans, or endless ones
    if not numbers or not (np.abs(given.astype(np.float64)) < MAX_LENGTH).all():
        kind = "x".join(str(side) for side in shape) + " numbers" if shape else "a number"
        raise SettingError(f"camera: expected {kind} as {key!r}, got {describe_value(data.get(key))}")
    return given.astype(np.float64)
