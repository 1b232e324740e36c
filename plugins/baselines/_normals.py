"""Oriented normals by open3d, with which `bpa` and `poisson` start.

A change here changes the results of both: raise their versions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.errors.missing_system_libraries import explain_missing_libraries
from z2p_core.interfaces import ScanError

NEIGHBORS = 16
"""Neighbours of a point for its normal, and for the graph along which normals are oriented."""


def estimate_oriented_normals(cloud: np.ndarray) -> Any:
    """open3d PointCloud of points (N, 3) with unit normals, oriented consistently along tangent planes.

    Raises:
        ScanError: too few points, or points that span no volume.
    """
    with explain_missing_libraries("open3d"):
        import open3d  # late: the pipeline extra

    if len(cloud) <= NEIGHBORS:
        raise ScanError(f"normals need more than {NEIGHBORS} points, got {len(cloud)}; give a denser cloud")
    points = np.ascontiguousarray(cloud, dtype=np.float64)
    if np.ptp(points, axis=0).max() == 0:
        raise ScanError(f"expected points on a surface, got {len(cloud)} at one place")
    scan = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    scan.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NEIGHBORS))
    try:
        scan.orient_normals_consistent_tangent_plane(NEIGHBORS)
    except RuntimeError as error:  # its triangulation fails for coplanar points
        message = f"the normals cannot be oriented ({error_reason(error)}); expected points that span a volume"
        raise ScanError(message) from error
    return scan


def mesh_arrays(mesh: Any) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64 and triangles (M, 3) int64 of an open3d mesh.

    Raises:
        ScanError: it has no triangle.
    """
    faces = np.array(mesh.triangles, dtype=np.int64).reshape(-1, 3)
    if len(faces) == 0:
        raise ScanError("the reconstruction has no triangle; give a denser cloud")
    return np.array(mesh.vertices, dtype=np.float64), faces
