"""Light on many points of a surface, from that on fewer of them.

Light varies slowly along a surface but for its direction: it is computed at some points, and found for others between
them by their own normals. Direct light is that of the unhidden area light, times the share of it that neighbors
receive; other light is that of the vector irradiance (Arvo, The irradiance Jacobian for partially occluded polyhedral
sources, 1994) of neighbors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.linalg import row_dots
from z2p_core.shading.area_light import area_light_samples, hemisphere_axes
from z2p_core.shading.light_transport import POINT_LIGHT_SAMPLES, LightField, Quality

LIGHT_NEIGHBORS = 8
"""Points from which light is interpolated."""
VECTOR_ALBEDO = 0.5
"""Albedo of the cloud for the direction of its indirect light."""
MIN_INDIRECT_SHARE = 0.1
"""Least indirect light of a normal that turns away from it, over that of its neighbors."""
MAX_LIGHT_RATIO = 4.0
"""Largest ratio of a point's light to its neighbors'."""


@dataclass(frozen=True)
class DetailLight:
    """Where M points of a surface lie among N points whose light is known, and how much light they get.

    Attributes:
        positions: (M, 3).
        normals: (M, 3), facing the viewer.
        neighbors: (M, K) int32, rows of the nearest of the N points.
        points: (N, 3).
        point_normals: (N, 3), facing the viewer.
        ratio: (M,), light by the point's own normal over the mean light of its neighbors.
    """

    positions: np.ndarray
    normals: np.ndarray
    neighbors: np.ndarray
    points: np.ndarray
    point_normals: np.ndarray
    ratio: np.ndarray

    def interpolate(self, values: np.ndarray) -> np.ndarray:
        """Values (M, C) of the M points, from those of the N points (N, C), C <= 16."""
        return native.interpolate_values(
            self.positions, self.normals, self.neighbors, self.points, self.point_normals, values
        )


def transfer_light(
    positions: np.ndarray, normals: np.ndarray, grid: native.NeighborGrid, light: LightField, visibility: np.ndarray,
    quality: Quality, occlusion: tuple[np.ndarray, np.ndarray],
) -> DetailLight:  # fmt: skip
    """Light on M positions (M, 3) with unit normals (M, 3) that face the viewer.

    Args:
        positions: on the surface, in world units.
        normals: theirs.
        grid: finds the points of `light` near a position.
        light: the light on N points.
        visibility: (2 A, N) int32, which of them see which (`begin_point_visibility`).
        quality: that with which the light was computed.
    """
    scene = light.scene
    neighbors = grid.neighbors_of_positions(positions, LIGHT_NEIGHBORS)
    vectors = native.gather_vectors(
        scene.points, scene.normals, hemisphere_axes(quality.sky_axes), visibility, light.bounced.points[-2],
        VECTOR_ALBEDO, scene.floor, *light.occlusion,
    )  # fmt: skip
    samples = area_light_samples(scene.light, POINT_LIGHT_SAMPLES)
    open_light = native.unshadowed_light(scene.points, scene.normals, *samples) / math.pi
    indirect = row_dots(vectors, scene.normals)
    known = np.column_stack([light.direct[0], open_light, indirect, vectors]).astype(np.float32)
    own = DetailLight(positions, normals, neighbors, scene.points, scene.normals, np.empty(0, np.float32))
    direct, open_mean, indirect_mean, *vector = own.interpolate(known).T
    share = np.clip(direct / np.maximum(open_mean, 1e-4), 0, 1)
    sky, near = occlusion
    own_direct = share * near * native.unshadowed_light(positions, normals, *samples) / np.float32(math.pi)
    own_indirect = sky * np.maximum(row_dots(np.stack(vector, axis=1), normals), MIN_INDIRECT_SHARE * indirect_mean)
    ratio = (own_direct + own_indirect) / np.maximum(direct + indirect_mean, 1e-4)
    return DetailLight(
        positions, normals, neighbors, scene.points, scene.normals, np.clip(ratio, 0, MAX_LIGHT_RATIO)
    )  # fmt: skip
