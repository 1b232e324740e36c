"""Surfels of clouds so dense that light is computed at some of their points only.

The image shows discs of all points that it has pixels for; their light comes from the lit points nearby.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.camera_placement.placed_camera import PlacedCamera, widened
from z2p_core.images import linear_from_srgb, srgb_from_linear
from z2p_core.interfaces import PointColors
from z2p_core.shading.detail_light import transfer_light
from z2p_core.shading.light_transport import LightField, Quality
from z2p_core.shading.surfels import make_surfels
from z2p_core.shading.textured_light import surface_albedo
from z2p_core.surface.noise_level import neighbor_count
from z2p_core.surface.normals import SurfacePoints, estimate_surface
from z2p_core.surface.subsampling import MAX_SURFACE_POINTS
from z2p_core.surface.viewer_facing import face_viewer
from z2p_core.surface.visible_points import typical_depth, visible_points
from z2p_renderer.plugins.gbuffers._shaders import MaterialShader

MIN_SPACING = 1e-5
"""Smallest spacing of the points that an image shows, in world units."""
PATCH_NEIGHBORS, MERGED_PATCH_NEIGHBORS = 16, 12
"""Neighbors to whose places a clean surface is fitted, once: more would smooth relief away, fewer are noisier; and as
many where shown points are means of `MERGED_POINTS`."""
MERGED_POINTS = 3.0
"""Points in a mean from which on fewer neighbors do, as their places are less random."""
MAX_RELIEF_TO_SPACING = 0.15
"""Noise, in spacings, up to which it is taken for fine relief, which more neighbors would smooth away."""
NEIGHBORS_PER_NOISE = 150.0
"""Neighbors added for each spacing of noise beyond, until there are as many as in a sparse cloud."""
BORDER_SPACINGS, MAX_BORDER_PIXELS = 4.0, 64
"""Border around the image of a user's camera whose points belong to patches as well, in the points' spacings."""


@dataclass(frozen=True)
class Detail:
    """What one image shows of a dense cloud."""

    surface: SurfacePoints
    """N points, each the mean of those in a small cell of the image."""
    surfels: SurfacePoints
    """M surfels: the N points, then those that close holes."""
    radii: np.ndarray
    """(M,) float32, of the surfels, in world units."""
    albedo: np.ndarray | None
    """(N, 3) float32, of the points, where the cloud has colors."""


def visible_detail(
    cloud: np.ndarray, surface: SurfacePoints, spacing: float, camera: Camera, colors: PointColors | None
) -> Detail | None:  # fmt: skip
    """What the camera sees of a dense cloud (N, 3); None where the points that are lit are drawn themselves.

    So are those of clouds that are not dense. `surface` has the points of the cloud that are lit, `spacing` is their
    median spacing.
    """
    if not shows_detail(cloud):
        return None
    own_spacing = spacing * math.sqrt(len(surface.points) / len(cloud))
    has_own_colors = colors is not None and np.array_equal(colors.points, cloud)
    values = colors.albedo if colors is not None and has_own_colors else None
    if isinstance(camera, PlacedCamera):
        pixels = math.ceil(BORDER_SPACINGS * max(own_spacing / camera.pixel_width(typical_depth(cloud, camera)), 1))
        camera = widened(camera, min(pixels, MAX_BORDER_PIXELS))
    merged = visible_points(cloud, values, camera, own_spacing, surface.noise)
    if not len(merged.points):  # all of it lies beside the image
        return None
    grid = native.ScreenGrid(merged.points, camera)
    count_neighbors = partial(count_patch_neighbors, mean_of=float(merged.numbers.mean()))
    shown = estimate_surface(merged.points, False, count_neighbors, grid, jet_iterations=1)
    surfels, radii = make_surfels(shown, typical_spacing(shown, camera))
    if merged.values is not None and shown.grid is grid:
        return Detail(shown, surfels, radii, merged.values[grid.order])
    if merged.values is not None:
        colors = PointColors(merged.points, merged.values)
    return Detail(shown, surfels, radii, None if colors is None else surface_albedo(shown, colors))


def shows_detail(cloud: np.ndarray) -> bool:
    """Whether images show more of a cloud (N, 3) than the points that are lit."""
    return len(cloud) > MAX_SURFACE_POINTS


def typical_spacing(shown: SurfacePoints, camera: Camera) -> float | np.ndarray:
    """Median spacing of the N shown points, in world units.

    Before a user's pinhole camera depths may differ much: the farther away points lie, the more of them share a pixel
    and are drawn as one. So there it is (N,), the median spacing in pixels at the depth of each point.
    """
    if camera.is_canonical or camera.orthographic:
        return max(float(np.median(shown.spacing)), MIN_SPACING)
    depth = np.maximum((shown.points - camera.position) @ camera.rotation[2], camera.near_plane)
    spacing: np.ndarray = np.maximum(np.median(shown.spacing / depth) * depth, MIN_SPACING).astype(np.float32)
    return spacing


def count_patch_neighbors(noise: float, mean_of: float = 1.0) -> int:
    """Number of neighbors that a patch is fitted to, for noise in spacings and points that are means of so many."""
    merged = min(max((mean_of - 1) / (MERGED_POINTS - 1), 0.0), 1.0)
    least = PATCH_NEIGHBORS + round(merged * (MERGED_PATCH_NEIGHBORS - PATCH_NEIGHBORS))
    beyond = NEIGHBORS_PER_NOISE * max(noise - MAX_RELIEF_TO_SPACING, 0)
    return int(min(least + beyond, neighbor_count(noise)))


class DetailShader:
    """A `MaterialShader` of the points of a `Detail`, by that of the lit points."""

    def __init__(
        self, shader: MaterialShader, detail: Detail, lit: SurfacePoints, field: LightField, visibility: np.ndarray,
        quality: Quality, camera: Camera,
    ) -> None:  # fmt: skip
        """`lit` are the points of the light `field`, `visibility` says which of them see which."""
        self._shader = shader
        normals = face_viewer(detail.surface.points, detail.surface.normals, camera.position)
        self._light = transfer_light(detail.surface, normals, lit, field, visibility, quality, camera)

    def surfel_values(self, viewer: np.ndarray) -> list[np.ndarray]:
        radiance, *further = self._shader.surfel_values(viewer)
        own = self._light.interpolate(linear_from_srgb(radiance)) * self._light.ratio[:, None]
        return [srgb_from_linear(np.clip(own, 0, 1)), *map(self._light.interpolate, further)]

    def shade_pixels(self, camera: Camera, rows: tuple[int, int], layers: list[np.ndarray]) -> None:
        self._shader.shade_pixels(camera, rows, layers)

    def total_albedo(self, albedo: np.ndarray) -> np.ndarray:
        """Of the lit points, as `albedo` (N, 3) is."""
        return self._shader.total_albedo(albedo)

    def relative_radiance(self, viewer: np.ndarray, radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the shown points, by the `radiance` (N, 3) of the lit ones."""
        offset, slope = self._shader.relative_radiance(viewer, radiance)
        return self._light.interpolate(offset), self._light.interpolate(slope)
