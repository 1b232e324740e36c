"""Light on many points of a surface, from that on fewer of them.

Light varies slowly along a surface but for its direction: it is computed at some points, and found for others between
them by their own normals. Direct light is that of the unhidden area light, times the share of it that the nearest lit
points receive; other light is their vector irradiance (Arvo, The Irradiance Jacobian for Partially Occluded Polyhedral
Sources, 1994) along the normal. What relief finer than the lit points hides is found on the screen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.linalg import rotate_points, row_dots
from z2p_core.shading.area_light import area_light_quad, area_light_samples, hemisphere_axes
from z2p_core.shading.light_transport import POINT_LIGHT_SAMPLES, LightField, Quality
from z2p_core.surface.normals import SurfacePoints
from z2p_core.surface.visible_points import CELLS_PER_PIXEL, typical_depth

LIGHT_NEIGHBORS = 8
"""Lit points from which light is interpolated."""
VECTOR_ALBEDO = 0.5
"""Albedo of the cloud for the direction of its indirect light."""
MIN_INDIRECT_SHARE = 0.1
"""Least indirect light of a normal that turns away from it, over that of the lit points."""
MAX_LIGHT_RATIO = 4.0
"""Largest ratio of a point's light to that of the lit points."""
MIN_RADIANCE = 1e-4
"""Least radiance that another one is divided by."""
RELIEF_SPACINGS = 2.0
"""Distance within which relief hides light, in spacings of the lit points: beyond, these see it themselves."""
RELIEF_ALBEDO = 0.3
"""Albedo of relief for the light that it sends to where it hides the sky: that with which detailed meshes look best."""
SPACINGS_PER_CELL = 1.2
"""Width of the screen's cells in which relief is searched, in spacings of its points: not many cells are empty."""


@dataclass(frozen=True)
class DetailLight:
    """Where M points of a surface lie among N lit points, and how much light they get."""

    positions: np.ndarray
    """(M, 3) float32."""
    normals: np.ndarray
    """(M, 3) float32, facing the viewer."""
    neighbors: np.ndarray
    """(M, K) int32, rows of lit points near each."""
    lit_points: np.ndarray
    """(N, 3) float32."""
    lit_normals: np.ndarray
    """(N, 3) float32, facing the viewer."""
    ratio: np.ndarray
    """(M,) float32, light by the point's own normal and relief over that interpolated from lit points."""

    def interpolate(self, values: np.ndarray) -> np.ndarray:
        """Values (M, C) of the M points, from those of the lit ones (N, C), C <= 16."""
        return native.interpolate_values(
            self.positions, self.normals, self.neighbors, self.lit_points, self.lit_normals, values
        )


def transfer_light(
    shown: SurfacePoints, normals: np.ndarray, lit: SurfacePoints, light: LightField, visibility: np.ndarray,
    quality: Quality, camera: Camera,
) -> DetailLight:  # fmt: skip
    """Light on the M points that an image shows.

    Args:
        shown: these points.
        normals: (M, 3), theirs, facing the camera.
        lit: N points of the same surface, in the order of `light`.
        light: the light on them, on the side that faces the camera.
        visibility: (2 A, N) int32, which of them see which (`begin_point_visibility`).
        quality: that with which the light was computed.
        camera: the image's.
    """
    scene, positions = light.scene, shown.points
    assert isinstance(lit.grid, native.NeighborGrid)  # on the screen only shown points are searched
    nearest = lit.grid.nearest_by_walk(positions, lit.neighbors)
    neighbors = np.ascontiguousarray(lit.neighbors[:, :LIGHT_NEIGHBORS])[nearest]
    place = DetailLight(positions, normals, neighbors, scene.points, scene.normals, np.empty(0, np.float32))
    samples = area_light_samples(scene.light, POINT_LIGHT_SAMPLES)
    vectors = native.gather_vectors(
        scene.points, scene.normals, hemisphere_axes(quality.sky_axes), visibility, light.bounced.points[-2],
        VECTOR_ALBEDO, scene.floor, *light.occlusion,
    )  # fmt: skip
    unhidden = native.unshadowed_light(scene.points, scene.normals, *samples)
    along = row_dots(vectors, scene.normals)
    known = np.column_stack([light.direct[0], unhidden / np.float32(math.pi), along, vectors])
    direct, unhidden, indirect, *vector = place.interpolate(known).T
    share = np.clip(direct / np.maximum(unhidden, MIN_RADIANCE), 0, 1)
    sky, near_light = _fine_occlusion(shown, normals, lit, light, camera)
    own_direct = share * near_light * native.unshadowed_light(positions, normals, *samples) / np.float32(math.pi)
    along_normal = row_dots(np.stack(vector, axis=1), normals)
    own_indirect = sky * np.maximum(along_normal, MIN_INDIRECT_SHARE * indirect)
    own_indirect += (1 - sky) * RELIEF_ALBEDO * (direct + indirect)  # what hides the sky is lit as well
    ratio = (own_direct + own_indirect) / np.maximum(direct + indirect, MIN_RADIANCE)
    return DetailLight(
        positions, normals, neighbors, scene.points, scene.normals, np.clip(ratio, 0, MAX_LIGHT_RATIO)
    )  # fmt: skip


def _fine_occlusion(
    shown: SurfacePoints, normals: np.ndarray, lit: SurfacePoints, light: LightField, camera: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Shares (M,) of sky and area light that relief between the lit points leaves visible from the M shown points."""
    rotation, position = camera.rotation.astype(np.float32), camera.position
    light_center = camera.rotation @ (area_light_quad(light.scene.light)[0] - position)
    pixel = camera.pixel_width(typical_depth(shown.points, camera))
    spacing = float(np.median(shown.spacing))
    cells_per_pixel = min(CELLS_PER_PIXEL, pixel / (SPACINGS_PER_CELL * max(spacing, 1e-6)))
    points = rotate_points(shown.points - position.astype(np.float32), rotation)
    reach = RELIEF_SPACINGS * float(np.median(lit.spacing))
    return native.fine_occlusion(
        points, rotate_points(normals, rotation), camera, light_center, cells_per_pixel, reach
    )  # fmt: skip
