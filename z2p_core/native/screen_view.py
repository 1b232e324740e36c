"""A camera's image as the kernels see it: a screen of pixels, or of cells of another width."""

from __future__ import annotations

import ctypes
import math

import numpy as np

from z2p_core.camera import Camera


class ScreenView(ctypes.Structure):
    """The C structure of that name (`c/common/screen_view.h`)."""

    _fields_ = [
        ("width", ctypes.c_int),
        ("height", ctypes.c_int),
        ("orthographic", ctypes.c_int),
        ("rotation", ctypes.c_float * 9),
        ("position", ctypes.c_float * 3),
        ("focal", ctypes.c_float * 2),
        ("center", ctypes.c_float * 2),
        ("near_depth", ctypes.c_float),
    ]


def screen_view(camera: Camera, pixels_per_cell: float = 1.0) -> ScreenView:
    """The camera's image in cells so many pixels wide, the last ones of rows and columns perhaps beyond its border."""
    width, height = (max(math.ceil(side / pixels_per_cell), 1) for side in (camera.width, camera.height))
    lengths = [np.array(pair) / pixels_per_cell for pair in (camera.focal_lengths, camera.principal_point)]
    floats = [camera.rotation.ravel(), camera.position, *lengths]
    arrays = [(ctypes.c_float * len(values))(*values) for values in floats]
    return ScreenView(width, height, camera.orthographic, *arrays, camera.near_plane)
