"""Farthest-point sampling: each point is the one farthest from those before it."""

from __future__ import annotations

import numpy as np

from z2p_core.errors.missing_system_libraries import explain_missing_libraries
from z2p_core.interfaces import Sampler
from z2p_core.meshes.triangle_sampling import sample_uniform

DENSITY = 4
"""Dense points for each point asked for; the time grows with it, the evenness hardly."""


class Farthest(Sampler):
    """Open3D's farthest-point selection out of a dense uniform sample, from a random first point."""

    name = "farthest"
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
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(dense))
        start = int(rng.integers(len(dense)))
        return np.array(cloud.farthest_point_down_sample(count, start).points)
