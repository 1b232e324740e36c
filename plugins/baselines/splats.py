"""Surface splats (Zwicker et al., Surface Splatting, 2001) as geometry: a disc in each point's tangent plane."""

from __future__ import annotations

import numpy as np

from z2p_core.errors.missing_system_libraries import explain_missing_libraries
from z2p_core.interfaces import Baseline, ScanError

NEIGHBORS = 12
"""Neighbours of a point for its tangent plane and spacing."""
RADIUS_IN_SPACINGS = 1.3
"""Radius of a disc in spacings, a spacing being the root of a point's area: large enough to leave few holes."""
DISC_CORNERS = 8
SQUARE_CORNERS = 4
MANY_POINTS = 200_000
"""Points from which on discs are squares of as large an area, of 2 triangles in place of 6: few pixels each."""
HEIGHT_JITTER_IN_SPACINGS = 0.05
"""Range of a disc's random offset along its normal, in spacings: coplanar discs would shadow each other."""


class Splats(Baseline):
    """An octagon around every point in its PCA tangent plane, two-sided, so that normals need no orientation."""

    name = "splats"
    version = "1"
    packages = ("open3d",)

    def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (8 N, 3) float64 and triangles (6 N, 3) int64; (4 N, 3) and (2 N, 3) from `MANY_POINTS` on.

        Raises:
            ScanError: too few points, or points at one place.
        """
        if len(cloud) <= NEIGHBORS:
            raise ScanError(f"splats need more than {NEIGHBORS} points, got {len(cloud)}; give a denser cloud")
        points = np.ascontiguousarray(cloud, dtype=np.float64)
        with self.timed("planes"):
            first, second, spacing = _tangent_axes(points)
        if not spacing.max() > 0:
            raise ScanError(f"expected points on a surface, got {len(cloud)} at one place")
        typical = float(np.median(spacing[spacing > 0]))
        radius = RADIUS_IN_SPACINGS * np.clip(spacing, 0.5 * typical, 2.5 * typical)
        corners = DISC_CORNERS if len(points) < MANY_POINTS else SQUARE_CORNERS
        angle = 2 * np.pi * np.arange(corners) / corners
        radius *= np.sqrt(_polygon_area(DISC_CORNERS) / _polygon_area(corners))
        rim = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
        height = HEIGHT_JITTER_IN_SPACINGS * typical * rng.uniform(-0.5, 0.5, (len(points), 1))
        vertices = (points + height * np.cross(first, second))[:, None] + radius[:, None, None] * rim
        fan = np.array([(0, corner, corner + 1) for corner in range(1, corners - 1)])
        faces = corners * np.arange(len(points))[:, None, None] + fan
        return vertices.reshape(-1, 3), faces.reshape(-1, 3)

    def reconstruct_colored(
        self, cloud: np.ndarray, albedo: np.ndarray, viewer: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same mesh, and colors (V, 3) of its vertices: each disc has that of its point."""
        vertices, faces = self.reconstruct(cloud, rng)
        return vertices, faces, np.repeat(albedo, len(vertices) // len(cloud), axis=0)


def _polygon_area(corners: int) -> float:
    """Area of a regular polygon of radius 1."""
    return float(corners / 2 * np.sin(2 * np.pi / corners))


def _tangent_axes(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two unit tangents, (N, 3) each, and the spacing (N,) of points (N, 3), by PCA of their nearest neighbours."""
    with explain_missing_libraries("open3d"):
        import open3d  # late: the pipeline extra

    positions = open3d.core.Tensor.from_numpy(points)
    search = open3d.core.nns.NearestNeighborSearch(positions)
    search.knn_index()
    neighbor_indices, squared_distances = (result.numpy() for result in search.knn_search(positions, NEIGHBORS + 1))
    neighbors = points[neighbor_indices]
    neighbors = neighbors - neighbors.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", neighbors, neighbors))  # ascending: the normal comes first
    spacing = np.sqrt(np.pi * squared_distances[:, -1] / NEIGHBORS)
    return axes[:, :, 1], axes[:, :, 2], spacing
