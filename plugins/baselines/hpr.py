"""Hidden point removal, and triangles between the visible points (Katz, Tal, Basri, SIGGRAPH 2007)."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera
from z2p_core.errors.messages import error_reason
from z2p_core.errors.missing_system_libraries import explain_missing_libraries
from z2p_core.interfaces import Baseline, ScanError
from z2p_renderer.plugins.baselines._normals import mesh_arrays

FLIP_RADIUS = 360.0
"""Radius of the sphere for spherical flipping, world units: a hundred times the camera's distance."""
MAX_SIDE_RATIO = 4.0
"""Longest side of a kept triangle, relative to the median: longer ones connect an outline to the background."""


class VisibleTriangles(Baseline):
    """Triangles of the visible side of the cloud alone, which also casts the shadows."""

    name = "hpr"
    version = "1"
    packages = ("open3d",)
    for_view = True

    def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """The mesh for the camera at its usual place; see `reconstruct_for`."""
        return self.reconstruct_for(cloud, Camera(1, 1).position, rng)

    def reconstruct_for(
        self, cloud: np.ndarray, viewer: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) float64, the visible points, and triangles (M, 3) int64 between them.

        Raises:
            ScanError: too few points, or points in one plane with the viewer.
        """
        with explain_missing_libraries("open3d"):
            import open3d  # late: the pipeline extra

        if len(cloud) < 5:
            raise ScanError(f"hidden point removal needs 5 points or more, got {len(cloud)}; give a denser cloud")
        scan = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.ascontiguousarray(cloud, np.float64)))
        try:
            mesh, _ = scan.hidden_point_removal(np.asarray(viewer, np.float64), FLIP_RADIUS)
        except RuntimeError as error:  # its convex hull refuses points in one plane
            message = f"the visible points cannot be found ({error_reason(error)}); expected points that span a volume"
            raise ScanError(message) from error
        vertices, faces = mesh_arrays(mesh)
        corners = vertices[faces]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        kept = longest <= MAX_SIDE_RATIO * np.median(longest)
        return vertices, faces[kept]
