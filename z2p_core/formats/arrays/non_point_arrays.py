"""Recognizes arrays that have a shape like points but hold depth maps, images or camera poses."""

from __future__ import annotations

import numpy as np

from z2p_core.formats.arrays.image_grids import GRID_ADVICE, is_grid, is_picture
from z2p_core.formats.tables.camera_poses import pose_kind
from z2p_core.interfaces import ScanError

_MAX_SAMPLED_ROWS = 1000
"""Rows of an array that are examined."""


@np.errstate(all="ignore")  # the numbers may be no coordinates
def refuse_other_arrays(array: np.ndarray) -> None:
    """Refuses numbers (N, C) or (B, N, C) that are clearly no points.

    Raises:
        ScanError: they are camera matrices, a list of poses, a depth map, a height grid or a color image.
    """
    if kind := pose_array_kind(array):
        raise ScanError(f"numbers {array.shape} are no points but {kind}; give points (N, 3)")
    if array.ndim == 2 and is_grid(array):
        raise ScanError(f"numbers {array.shape} look like a depth map or a grid of heights, not like points; "
                        f"{GRID_ADVICE}")
    if array.ndim == 3 and is_picture(array):
        raise ScanError(f"numbers {array.shape} look like a colour picture, not like points; give the x y z of its "
                        "pixels instead")


def pose_array_kind(array: np.ndarray) -> str:
    """Description of camera poses or matrices, one or several; empty for any other array."""
    return pose_kind(_rows_of_poses(array))


def _rows_of_poses(array: np.ndarray) -> np.ndarray:
    """The array reshaped to a list of poses (N, M), one per row; (0, 3) if its shape is not that of poses."""
    if array.ndim == 3 and array.shape[1:] in ((4, 4), (3, 4)):
        array = array.reshape(len(array), array.shape[1] * 4)
    elif array.ndim == 3 and array.shape[1:] == (3, 3):
        array = np.concatenate([array, np.zeros((len(array), 3, 1))], axis=2).reshape(len(array), 12)
    with np.errstate(invalid="ignore"):  # signaling NaN
        return array[:_MAX_SAMPLED_ROWS].astype(np.float64) if array.ndim == 2 else np.empty((0, 3))
