"""A small ball at each point, as renderers show a cloud without reconstruction."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Baseline, ScanError

BALL_RADIUS = 0.014
"""World units, whatever the density: balls almost touch for an object of 5,000 points."""
SUBDIVISIONS = 1
"""Of the icosahedron: 80 smooth-shaded triangles suffice for a ball of a few pixels."""
MANY_POINTS = 20_000
"""Points from which on balls are not subdivided: 20 triangles each."""


class Balls(Baseline):
    """An icosphere of radius `BALL_RADIUS` around every point."""

    name = "balls"
    version = "2"
    packages = ("trimesh",)

    def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (42 N, 3) float64 and triangles (80 N, 3) int64; (12 N, 3) and (20 N, 3) from `MANY_POINTS` on.

        Raises:
            ScanError: no points.
        """
        from trimesh.creation import icosphere  # late: slow to import

        if len(cloud) == 0:
            raise ScanError("expected at least 1 point to put a ball on, got none")
        ball = icosphere(subdivisions=SUBDIVISIONS if len(cloud) < MANY_POINTS else 0, radius=BALL_RADIUS)
        vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces, dtype=np.int64)
        first = len(vertices) * np.arange(len(cloud))[:, None, None]
        placed = np.asarray(cloud, dtype=np.float64)[:, None] + vertices
        return placed.reshape(-1, 3), (first + faces).reshape(-1, 3)

    def reconstruct_colored(
        self, cloud: np.ndarray, albedo: np.ndarray, viewer: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same mesh, and colors of its vertices: each ball has that of its point."""
        vertices, faces = self.reconstruct(cloud, rng)
        return vertices, faces, np.repeat(albedo, len(vertices) // len(cloud), axis=0)
