"""What is drawn onto a picture beside its color bar: a scale bar, and axes in the data's units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from z2p_core.camera import DISTANCE, Camera
from z2p_core.camera_placement.zoomed_camera import zoomed_camera
from z2p_core.placement.viewpoint import Viewpoint


@dataclass(frozen=True)
class Marks:
    """What the user wants to be drawn."""

    scale_bar: bool = False
    axes: bool = False
    unit: str = ""
    """Unit of the data's coordinates, written behind the lengths; empty where it is not known."""

    def __bool__(self) -> bool:
        return self.scale_bar or self.axes


@dataclass(frozen=True)
class FrameGeometry:
    """Where the points of the data are in a picture."""

    viewpoint: Viewpoint
    """What placed the cloud, the margin included."""
    width: int
    """Width of the whole frame, pixels."""
    height: int
    """Height of the whole frame, pixels."""
    left: int
    """Column of the frame at which the picture begins, if it was trimmed; may be negative."""
    top: int
    """Row of the frame at which the picture begins."""
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]]
    """The lowest and the highest coordinates of the cloud along the data's axes, in the data's units."""

    @property
    def pixels_per_unit(self) -> float:
        """Pixels that a length of 1 in the data's units has at the middle of the object, across the line of sight."""
        return self._camera.focal / DISTANCE / self.viewpoint.radius

    @property
    def eye(self) -> np.ndarray:
        """Where the camera stands (3,), in the data's coordinates."""
        world = self._camera.position
        return world @ np.array(self.viewpoint.rotation) * self.viewpoint.radius + np.array(self.viewpoint.centre)

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (N, 2) in the picture, right and down, and depths (N,) of points (N, 3) in the data's coordinates."""
        world = (points - np.array(self.viewpoint.centre)) / self.viewpoint.radius @ np.array(self.viewpoint.rotation).T
        pixels, depth = self._camera.project(world)
        return pixels - (self.left, self.top), depth

    @property
    def _camera(self) -> Camera:
        elevation, zoom = self.viewpoint.elevation, self.viewpoint.zoom
        if zoom:
            return zoomed_camera(self.width, self.height, elevation, zoom)
        return Camera(self.width, self.height, elevation)
