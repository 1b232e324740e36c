"""The camera that Blender, the z-buffer and the G-buffer share, and the world coordinates that it looks at.

World: right-handed, +Z up, the floor below. The object's bounding sphere is centered and scaled to radius 1. The
camera stands on the -Y side and looks at the origin from `DISTANCE`, `elevation` degrees above the horizon; its axes
are OpenCV's (+X right, +Y down, +Z forward). Pixels are square; pixel (column i, row j) covers [i, i+1) x [j, j+1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

DISTANCE = 3.6
"""From the camera to the origin, in world units."""
DEPTH_RANGE = (DISTANCE - 1, DISTANCE + 1)
"""Depths of the nearest and the farthest point of the unit sphere, in world units."""
FIELD_OF_VIEW = 40.0
"""Angle across the shorter side of the image, in degrees: vertical in square and landscape ones, so nothing is cut."""
DEFAULT_ELEVATION = 20.0
"""Degrees above the horizon."""
NEAR_PLANE = 0.1
"""Smallest depth that is drawn, in world units."""

Numbers = TypeVar("Numbers", float, np.ndarray)


@dataclass(frozen=True)
class Camera:
    """Pinhole camera; `width` and `height` in pixels, `elevation` in degrees above the horizon (0 to 80)."""

    width: int
    height: int
    elevation: float = DEFAULT_ELEVATION

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return min(self.width, self.height) / 2 / math.tan(math.radians(FIELD_OF_VIEW / 2))

    @property
    def focal_lengths(self) -> tuple[float, float]:
        """Focal lengths along x and y, in pixels; those of an orthographic camera are pixels per world unit."""
        return self.focal, self.focal

    @property
    def principal_point(self) -> tuple[float, float]:
        """Where the optical axis meets the image, in pixels."""
        return self.width / 2, self.height / 2

    @property
    def orthographic(self) -> bool:
        """Whether all rays are parallel, and depths do not change sizes."""
        return False

    @property
    def near_plane(self) -> float:
        """Smallest depth that is drawn, in world units."""
        return NEAR_PLANE

    @property
    def depth_range(self) -> tuple[float, float]:
        """Depths of the nearest and the farthest point of the unit sphere, in world units."""
        return DEPTH_RANGE

    @property
    def is_canonical(self) -> bool:
        """Whether pixels are square, the image is centered on the optical axis, and the origin lies on that axis.

        The kernels for the floor's shadow and for z-buffers rely on all three, and on a horizontal x axis.
        """
        return True

    @property
    def intrinsics(self) -> np.ndarray:
        """Matrix K (3, 3) float64, from camera axes to pixels."""
        return np.array(
            [[self.focal, 0, self.width / 2], [0, self.focal, self.height / 2], [0, 0, 1]], dtype=np.float64
        )

    @property
    def position(self) -> np.ndarray:
        """Camera center (3,) in the world."""
        angle = math.radians(self.elevation)
        return DISTANCE * np.array([0.0, -math.cos(angle), math.sin(angle)])

    @property
    def rotation(self) -> np.ndarray:
        """Matrix R (3, 3) from world axes to OpenCV camera axes; rows are the camera's right, down and forward."""
        angle = math.radians(self.elevation)
        sin, cos = math.sin(angle), math.cos(angle)
        return np.array([[1.0, 0.0, 0.0], [0.0, -sin, -cos], [0.0, cos, -sin]])

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixel coordinates (N, 2), x right and y down, and depths (N,), of world points (N, 3).

        Depth is the distance to the camera's plane, d_p in Eq. 1 of the paper. A pixel's center is at +0.5.
        """
        in_camera = (points - self.position.astype(points.dtype)) @ self.rotation.T.astype(points.dtype)
        depth = in_camera[:, 2]
        center = np.array([self.width / 2, self.height / 2], dtype=points.dtype)
        return in_camera[:, :2] * (self.focal / depth)[:, None] + center, depth

    def pixel_width(self, depth: Numbers) -> Numbers:
        """Width of a pixel in world units at a depth, or at each of several."""
        return depth / self.focal

    def frame_coordinates(self, step: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Positions u, v (height/step, width/step) float32 of the centers of step x step cells.

        They run over [0, 1] in the square frame, as in Eq. 3 of the paper, and beyond it along a longer side.
        """
        side = min(self.width, self.height)
        column = (np.arange(0, self.width, step) + step / 2 - self.width / 2) / side + 0.5
        row = (np.arange(0, self.height, step) + step / 2 - self.height / 2) / side + 0.5
        u, v = np.meshgrid(column.astype(np.float32), row.astype(np.float32))
        return u, v


@dataclass(frozen=True)
class TurnedCamera(Camera):
    """A camera that is turned about the world's Z axis, by `azimuth` degrees counter-clockwise from above.

    What it sees is what `Camera` sees of a world that is turned by as much the other way.
    """

    azimuth: float = 0.0

    @property
    def position(self) -> np.ndarray:
        position: np.ndarray = turn(self.azimuth) @ super().position
        return position

    @property
    def rotation(self) -> np.ndarray:
        rotation: np.ndarray = super().rotation @ turn(self.azimuth).T
        return rotation


def light_position(light: tuple[float, float, float]) -> np.ndarray:
    """World position (3,) of a light given as radius, azimuth and elevation (degrees) relative to the camera.

    Azimuth 0 is behind the camera (-Y), positive goes to image right (+X).
    """
    radius, azimuth, elevation = light[0], math.radians(light[1]), math.radians(light[2])
    return radius * np.array(
        [math.sin(azimuth) * math.cos(elevation), -math.cos(azimuth) * math.cos(elevation), math.sin(elevation)]
    )


def turn(azimuth: float) -> np.ndarray:
    """Rotation matrix (3, 3) about +Z by `azimuth` degrees, counter-clockwise from above, by which a view is turned."""
    angle = math.radians(azimuth)
    sin, cos = math.sin(angle), math.cos(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
