"""Ball-pivoting surface reconstruction (Bernardini et al., TVCG 1999)."""

from __future__ import annotations

from typing import Any

import numpy as np

from z2p_core.errors.missing_system_libraries import explain_missing_libraries
from z2p_core.interfaces import Baseline, ScanError
from z2p_renderer.plugins.baselines._normals import estimate_oriented_normals, mesh_arrays
from z2p_renderer.plugins.baselines._subprocess import SubprocessFunction

RADII_IN_SPACINGS = (1.5, 2.5, 4.0)
"""Radii of the balls, in units of the mean distance to the nearest neighbour."""
TIME_LIMIT_SECONDS = 300.0
"""On scans of strongly varying density open3d's ball pivoting takes hours, or does not end."""


class BallPivoting(Baseline):
    """Open3D's ball pivoting with three balls that follow the cloud's spacing; holes wider than those stay open."""

    name = "bpa"
    version = "1"
    packages = ("open3d",)

    def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) float64, the cloud's points, and triangles (M, 3) int64 between them.

        Raises:
            ScanError: too few points, points on which no triangle forms, or the time limit is exceeded.
        """
        with self.timed("normals"):
            scan = estimate_oriented_normals(cloud)
        spacing = float(np.mean(scan.compute_nearest_neighbor_distance()))
        if spacing == 0:
            raise ScanError(f"expected points apart from each other, got {len(cloud)} that all come twice")
        radii = [radius * spacing for radius in RADII_IN_SPACINGS]
        vertices, faces = BALL_PIVOTING_SUBPROCESS(
            np.asarray(scan.points), np.asarray(scan.normals), radii, within=TIME_LIMIT_SECONDS
        )
        return vertices, faces


def ball_pivoting(points: np.ndarray, normals: np.ndarray, radii: list[float]) -> Any:
    """Vertices (V, 3) float64 and triangles (M, 3) int64 of ball pivoting on oriented points (N, 3).

    Raises:
        ScanError: there is no triangle.
    """
    with explain_missing_libraries("open3d"):
        import open3d  # late: the pipeline extra

    scan = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    scan.normals = open3d.utility.Vector3dVector(normals)
    balls = open3d.utility.DoubleVector(radii)
    return mesh_arrays(open3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(scan, balls))


BALL_PIVOTING_SUBPROCESS = SubprocessFunction(ball_pivoting)
