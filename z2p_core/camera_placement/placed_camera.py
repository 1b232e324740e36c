"""Any pinhole or orthographic camera in the world of `z2p_core.camera`: what a user's camera becomes for drawing.

The z-buffer, the G-buffer and the network know a camera that looks at the unit sphere's middle from `DISTANCE`. Two
things make others look alike to them: depths are counted so that the origin lies at that distance, and positions in the
frame so that the unit sphere fills it as usual, wherever it lies in the image and however large it is there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from z2p_core.camera import DEFAULT_ELEVATION, DISTANCE, FIELD_OF_VIEW, Camera, Numbers
from z2p_core.linalg import rotate_points
from z2p_core.pinhole import PinholeCamera
from z2p_core.placement.viewpoint import Viewpoint

ORTHOGRAPHIC_DISTANCE = 100.0
"""From which an orthographic camera is taken to see the origin where a position is needed, in world units: rays to it
are parallel within a degree, and float32 depths are right to 0.00001."""
PLACED_NEAR_PLANE = 0.01
"""Smallest depth that is drawn by a camera of the user's, in world units."""
FRAME_PER_FOCAL = 2 * math.tan(math.radians(FIELD_OF_VIEW / 2)) * DISTANCE
"""Side of the frame that the unit sphere is used to, in pixels, for each pixel of a world unit at the origin."""

Rows = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class PlacedCamera(Camera):
    """A camera anywhere in the world; `elevation` is that of its position over the origin's horizon, in degrees.

    `focals` and `center` are in pixels, `axes` the rows right, down and forward, `station` the camera's position.
    """

    focals: tuple[float, float] = (1.0, 1.0)
    center: tuple[float, float] = (0.0, 0.0)
    axes: Rows = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    station: tuple[float, float, float] = (0.0, -DISTANCE, 0.0)
    parallel: bool = False

    @property
    def focal(self) -> float:
        """Mean focal length in pixels."""
        return math.sqrt(self.focals[0] * self.focals[1])

    @property
    def focal_lengths(self) -> tuple[float, float]:
        """Focal lengths along x and y, in pixels; those of an orthographic camera are pixels per world unit."""
        return self.focals

    @property
    def principal_point(self) -> tuple[float, float]:
        """Where the optical axis meets the image, in pixels."""
        return self.center

    @property
    def orthographic(self) -> bool:
        """Whether all rays are parallel."""
        return self.parallel

    @property
    def near_plane(self) -> float:
        """Smallest depth that is drawn, in world units."""
        return PLACED_NEAR_PLANE

    @property
    def is_canonical(self) -> bool:
        """False: pixels, frame and direction are whatever the user's camera has."""
        return False

    @property
    def intrinsics(self) -> np.ndarray:
        """Matrix K (3, 3) float64, from camera axes to pixels."""
        (fx, fy), (cx, cy) = self.focals, self.center
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64)

    @property
    def position(self) -> np.ndarray:
        """Camera center (3,) in the world; of an orthographic camera, a far point on its axis."""
        return np.array(self.station)

    @property
    def rotation(self) -> np.ndarray:
        """Matrix R (3, 3) from world axes to OpenCV camera axes."""
        return np.array(self.axes)

    @property
    def origin_depth(self) -> float:
        """Depth of the origin, in world units; negative behind the camera."""
        return float(-self.rotation[2] @ self.position)

    @property
    def origin_distance(self) -> float:
        """Distance from the camera to the origin, in world units; infinite for parallel rays."""
        return math.inf if self.parallel else float(np.linalg.norm(self.position))

    @property
    def pixels_per_unit(self) -> float:
        """Pixels of a world unit at the origin's distance."""
        return self.focal if self.parallel else self.focal / max(self.origin_distance, PLACED_NEAR_PLANE)

    @property
    def depth_range(self) -> tuple[float, float]:
        """Depths of the nearest and the farthest point of the unit sphere, in world units."""
        return self.origin_depth - 1, self.origin_depth + 1

    def pixel_width(self, depth: Numbers) -> Numbers:
        """Width of a pixel in world units at a depth, or at each of several; mean of both sides of oblong ones."""
        if not self.parallel:
            return depth / self.focal
        return np.full_like(depth, 1 / self.focal) if isinstance(depth, np.ndarray) else 1 / self.focal

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixel coordinates (N, 2), x right and y down, and depths (N,), of world points (N, 3)."""
        in_camera = rotate_points(points - self.position.astype(points.dtype), self.rotation.astype(points.dtype))
        depth = in_camera[:, 2]
        flat = in_camera[:, :2] if self.parallel else in_camera[:, :2] / depth[:, None]
        return flat * np.array(self.focals, points.dtype) + np.array(self.center, points.dtype), depth

    def unproject(self, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """World points (N, 3) at pixel coordinates (N, 2) and depths (N,); the inverse of `project`."""
        flat = (pixels - np.array(self.center)) / np.array(self.focals)
        flat = flat if self.parallel else flat * depth[:, None]
        in_camera = np.column_stack([flat, depth])
        points: np.ndarray = rotate_points(in_camera, self.rotation.T) + self.position
        return points

    def frame_coordinates(self, step: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Positions u, v (height/step, width/step) float32 in the frame that the unit sphere would fill as usual."""
        side = FRAME_PER_FOCAL * self.pixels_per_unit
        middle = self.project(np.zeros((1, 3)))[0][0] if self.origin_depth > 0 or self.parallel else self.center
        column = (np.arange(0, self.width, step) + step / 2 - middle[0]) / side + 0.5
        row = (np.arange(0, self.height, step) + step / 2 - middle[1]) / side + 0.5
        u, v = np.meshgrid(column.astype(np.float32), row.astype(np.float32))
        return u, v

    def resized(self, width: int, height: int) -> PlacedCamera:
        """The same camera with another number of pixels for the same picture."""
        across, down = width / self.width, height / self.height
        (fx, fy), (cx, cy) = self.focals, self.center
        focals, center = (fx * across, fy * down), (cx * across, cy * down)
        return PlacedCamera(width, height, self.elevation, focals, center, self.axes, self.station, self.parallel)


def widened(camera: PlacedCamera, border: int) -> PlacedCamera:
    """The same camera with so many more pixels on each side."""
    center = (camera.center[0] + border, camera.center[1] + border)
    return replace(camera, width=camera.width + 2 * border, height=camera.height + 2 * border, center=center)


def reaches_border(cloud: np.ndarray, camera: PlacedCamera) -> bool:
    """Whether the camera sees some points of a cloud (N, 3) in its image, and others beside it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels, depth = camera.project(cloud)
    inside = (depth > camera.near_plane) & (pixels >= 0).all(1) & (pixels < (camera.width, camera.height)).all(1)
    return bool(inside.any() and not inside.all())


def place_camera(camera: PinholeCamera, viewpoint: Viewpoint) -> PlacedCamera:
    """The user's camera in the world that a viewpoint places the data in."""
    to_world = np.array(viewpoint.rotation)
    axes = np.array(camera.rotation) @ to_world.T
    station = to_world @ ((camera.position - np.array(viewpoint.centre)) / viewpoint.radius)
    focals = (camera.focal[0], camera.focal[1])
    if camera.orthographic:
        station = station - axes[2] * (axes[2] @ station + ORTHOGRAPHIC_DISTANCE)
        focals = (focals[0] * viewpoint.radius, focals[1] * viewpoint.radius)
    toward = -axes[2] if camera.orthographic else station
    length = float(np.linalg.norm(toward))
    elevation = math.degrees(math.asin(max(-1.0, min(1.0, float(toward[2]) / length)))) if length else DEFAULT_ELEVATION
    rows = cast(Rows, tuple(tuple(row) for row in axes.tolist()))
    x, y, z = station.tolist()
    return PlacedCamera(camera.width, camera.height, elevation, focals, camera.center, rows, (x, y, z),
                        camera.orthographic)  # fmt: skip
