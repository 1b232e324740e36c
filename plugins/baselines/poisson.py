"""Screened Poisson surface reconstruction (Kazhdan and Hoppe, TOG 2013), trimmed at low density."""

from __future__ import annotations

import numpy as np

from z2p_core.errors.missing_system_libraries import explain_missing_libraries
from z2p_core.interfaces import Baseline
from z2p_renderer.plugins.baselines._normals import estimate_oriented_normals, mesh_arrays

OCTREE_DEPTH = 8
"""Depth of the octree: 256 cells along a side."""
TRIMMED_SHARE = 0.03
"""Share of vertices removed, those of lowest density; else the surface closes every gap."""


class Poisson(Baseline):
    """Open3D's screened Poisson surface, single-threaded, as threads change the order of sums and so the bytes."""

    name = "poisson"
    version = "1"
    packages = ("open3d",)

    def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) float64 and triangles (M, 3) int64 of the trimmed surface.

        Raises:
            ScanError: too few points, or no surface found.
        """
        with explain_missing_libraries("open3d"):
            import open3d  # late: the pipeline extra

        with self.timed("normals"):
            scan = estimate_oriented_normals(cloud)
        mesh, densities = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            scan, depth=OCTREE_DEPTH, n_threads=1
        )
        density: np.ndarray = np.asarray(densities)
        if len(density):
            mesh.remove_vertices_by_mask(density < np.quantile(density, TRIMMED_SHARE))
        return mesh_arrays(mesh)
