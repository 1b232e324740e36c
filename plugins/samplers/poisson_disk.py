"""Poisson-disk sampling: random points with even gaps (sample elimination, Yuksel, Eurographics 2015)."""

from __future__ import annotations

import numpy as np

from z2p_core.errors.missing_system_libraries import explain_missing_libraries
from z2p_core.interfaces import Sampler
from z2p_core.meshes.triangle_sampling import sample_uniform

DENSITY = 5
"""Dense points for each point asked for, as in the elimination's paper."""


class PoissonDisk(Sampler):
    """Open3D's sample elimination on a dense sample of ours, so that only `rng` decides the points."""

    name = "poisson_disk"
    version = "1"
    packages = ("open3d",)

    def sample(self, vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        """Points (count, 3) float64.

        Raises:
            ScanError: no triangle has an area above 0.
        """
        with explain_missing_libraries("open3d"):
            import open3d  # late: the pipeline extra

        dense = sample_uniform(vertices, faces, count * DENSITY, rng)
        mesh = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(np.asarray(vertices, dtype=np.float64)),
            open3d.utility.Vector3iVector(np.asarray(faces, dtype=np.int32)),
        )
        pool = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(dense))
        return np.array(mesh.sample_points_poisson_disk(count, pcl=pool).points)
