"""Uniform sampling: every place on the surface is equally likely (the paper's training clouds)."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Sampler
from z2p_core.meshes.triangle_sampling import sample_uniform


class Uniform(Sampler):
    """Triangles drawn by area, a uniform point in each."""

    name = "uniform"
    version = "1"

    def sample(self, vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        """Points (count, 3) float64.

        Raises:
            ScanError: no triangle has an area above 0.
        """
        return sample_uniform(vertices, faces, count, rng)
