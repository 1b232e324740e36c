"""Screened Poisson reconstruction (Kazhdan and Hoppe, TOG 2013), trimmed where no points support it."""

from __future__ import annotations

import numpy as np

from z2p_core.errors.missing_system_libraries import explain_missing_libraries
from z2p_core.interfaces import Baseline
from z2p_renderer.plugins.baselines._normals import mesh_arrays, estimate_oriented_normals

OCTREE_DEPTH = 8
"""Of the octree: 256 cells a side."""
TRIMMED_SHARE = 0.03
"""Share of the vertices that go, those of lowest density: the surface closes over every gap otherwise."""


class Poisson(Baseline):
    """Open3D's screened Poisson surface, on one thread: on more, sums in another order give other bytes."""

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
        mesh, densities = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(scan, depth=OCTREE_DEPTH, n_threads=1)
        density: np.ndarray = np.asarray(densities)
        if len(density):
            mesh.remove_vertices_by_mask(density < np.quantile(density, TRIMMED_SHARE))
        return mesh_arrays(mesh)
