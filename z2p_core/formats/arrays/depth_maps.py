"""Unprojects depth maps to points with the intrinsics of their camera."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from z2p_core.interfaces import ScanError

DEPTH_KEYS = ("depth", "depths", "depth_map", "depthmap")
CAMERA_KEYS = ("k", "intrinsics", "intrinsic", "camera_matrix", "cam_k", "camera_intrinsics")
"""Usual names, lower-case, of a depth map and of its camera matrix."""


def find_depth_and_camera(names: Collection[str]) -> tuple[str, str] | None:
    """The names of the depth map and of the camera matrix among `names`; None unless there are both."""
    by_lower = {name.lower(): name for name in names}
    depth, camera = (next((by_lower[key] for key in keys if key in by_lower), None)
                     for keys in (DEPTH_KEYS, CAMERA_KEYS))  # fmt: skip
    return None if depth is None or camera is None else (depth, camera)


def unproject_depth(depth: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """Points (B, H, W, 3) in the camera's OpenCV axes.

    Args:
        depth: depths (H, W) or (B, H, W) along the viewing direction, 0 where nothing was measured.
        camera: intrinsics (3, 3) or (4, 4) in pixels, or B such matrices.

    Raises:
        ScanError: the shapes differ from these, or a matrix has no focal lengths.
    """
    depths = depth[..., 0] if depth.ndim > 2 and depth.shape[-1] == 1 else depth
    depths = depths[None] if depths.ndim == 2 else depths
    cameras = camera[None] if camera.ndim == 2 else camera
    if depths.ndim != 3 or cameras.shape[1:] not in ((3, 3), (4, 4)) or len(cameras) not in (1, len(depths)):
        raise ScanError(f"expected a depth map (H, W) and its camera's matrix (3, 3), got {depth.shape} and "
                        f"{camera.shape}")
    focal = cameras[:, (0, 1), (0, 1)]
    if not (np.isfinite(cameras).all() and (np.abs(focal) > 0).all()):
        raise ScanError("the camera's matrix beside the depth map has no focal lengths; save it as fx 0 cx, 0 fy cy, "
                        "0 0 1")
    rows, columns = np.mgrid[: depths.shape[1], : depths.shape[2]]
    centre = cameras[:, (0, 1), (2, 2)]
    x, y = (((pixels - centre[:, axis, None, None]) / focal[:, axis, None, None]) * depths
            for axis, pixels in ((0, columns), (1, rows)))  # fmt: skip
    return np.stack([x, y, np.broadcast_to(depths, x.shape)], axis=-1)
