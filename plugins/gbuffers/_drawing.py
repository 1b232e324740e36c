"""Steps of drawing surfels, and what goes from one to another."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.interfaces import PointColors
from z2p_core.linalg import rotate_points
from z2p_core.parallel import parallel_rows
from z2p_core.scene import SceneDescription
from z2p_core.shading.light_transport import (
    LightScene,
)
from z2p_core.surface.normals import SurfacePoints
from z2p_core.surface.viewer_facing import face_viewer
from z2p_renderer.plugins.gbuffers._detail import Detail
from z2p_renderer.plugins.gbuffers._shaders import Shader

BLENDING = native.Blending(blend_depth_radii=0.7, coverage_gain=15.0, full_weight=2.7)
"""Coverage is low where only a disc's rim is; density is 1 within a surface and about a third of that at its border."""
DETAIL_BLENDING = replace(BLENDING, opaque_weight=0.3)
"""That of a dense cloud's discs, hardly larger than pixels: where their rims cover little they hide nothing."""
SPARSE_QUANTILE, SPARSE_SPACING_SHARE = 0.9, 0.6
"""Light takes the cloud's spacing to be at least this share of this quantile of its points' spacings."""
ONE_SET_MAX_SIDE = 600
"""Longer side of an image up to which one set of light samples casts the floor's shadow, in pixels."""
TWO_SETS_MAX_SIDE = 900
"""Side up to which two sets do; for larger images there are four, as the steps in a penumbra grow with the image."""
HOLE_RIM_POINTS = 4
"""Points at the rim of a hole whose mean color its surfel gets."""
STRIPS = 6
"""Strips of an image that the cores rasterize in turn. One core draws the same strips: surfels are culled within each
strip, so that other strips would change a few pixels near their borders."""


@dataclass(frozen=True)
class Texture:
    """Colors of a surface, and the image (3, H, W) that receives its radiance relative to one in the base color."""

    colors: PointColors
    relative: np.ndarray


@dataclass(frozen=True)
class SurfelGeometry:
    """A cloud's surface as it is drawn: it depends neither on the camera nor on the light."""

    surface: SurfacePoints
    spacing: float
    """Median distance between neighboring points, in world units."""
    surfels: SurfacePoints
    """M surfels: the surface's N points, then those that close holes."""
    radii: np.ndarray
    """(M,) float32, of the surfels, in world units."""


@dataclass(frozen=True)
class SeenPoints:
    """Which points the points and the floor's cells see: it depends on the floor's height, not on the light."""

    by_points: np.ndarray
    """(2 A, N) int32, see `begin_point_visibility`."""
    by_floor: np.ndarray
    """(A, 2, N) int32, see `begin_floor_visibility`."""


def light_scene(
    surface: SurfacePoints, normals: np.ndarray, spacing: float, scene: SceneDescription, floor: float
) -> LightScene:  # fmt: skip
    """The surface's points with these normals (N, 3) under the scene's light, above a floor at that height.

    Shadows take the cloud to be as sparse as its sparser regions, so that they stay closed there.
    """
    sparse_spacing = SPARSE_SPACING_SHARE * float(np.quantile(surface.spacing, SPARSE_QUANTILE))
    return LightScene.create(surface.points, normals, max(spacing, sparse_spacing), scene, floor)


def light_sample_sets(camera: Camera) -> int:
    """How many sets of light samples cast the floor's shadow in an image of that size."""
    side = max(camera.width, camera.height)
    return 1 if side <= ONE_SET_MAX_SIDE else 2 if side <= TWO_SETS_MAX_SIDE else 4


def project_surfels(geometry: SurfelGeometry, detail: Detail | None, camera: Camera) -> native.Discs:
    """The surfels as the camera sees them: lowered to the curved surface on average, and clipped where it bends.

    They are the geometry's, or those of a dense cloud's `detail`.
    """
    drawn = geometry if detail is None else detail
    surfels, radii = drawn.surfels, drawn.radii
    rotation = camera.rotation.astype(np.float32)
    normals = face_viewer(surfels.points, surfels.normals, camera.position)
    centers = native.offset_disc_centers(surfels.points, normals, radii, surfels.neighbors)
    normals = rotate_points(normals, rotation)
    centers = rotate_points(centers - camera.position.astype(np.float32), rotation)
    clip_planes = native.disc_clip_planes(centers, normals, radii, surfels.neighbors)
    return native.Discs(centers, normals, radii, clip_planes)


def rasterize(
    discs: native.Discs, neighbors: np.ndarray, shader: Shader, camera: Camera, out: np.ndarray,
    textures: np.ndarray | None = None, colors_out: np.ndarray | None = None, blending: native.Blending = BLENDING,
) -> None:  # fmt: skip
    """Draws shaded discs into `out` (9, H, W), the channels `RASTERIZED`; both cores take strips of it in turn.

    `neighbors` (M, K) int32 are the points nearest to each disc; the first N discs belong to points, the others close
    holes. The kernel averages six values of each disc. The first layer has two components of the normal and four
    radiances; a further one, for shaders that need it, the third component and five more values.
    `textures`, if any, are drawn into `colors_out` (3, H, W) along with the first layer.
    """
    first, *further = (fill_holes(values, neighbors) for values in shader.surfel_values(camera.position))
    features = [np.column_stack([discs.normals[:, :2], first])]
    features += [np.column_stack([discs.normals[:, 2], values]) for values in further]
    layers = [out, *(np.empty_like(out) for _ in further)]

    def draw_strips(begin: int, end: int) -> None:
        for strip in range(begin, end):
            rows = (strip * camera.height // STRIPS, (strip + 1) * camera.height // STRIPS)
            for index, (values, layer) in enumerate(zip(features, layers, strict=True)):
                texture = (textures, colors_out) if index == 0 else (None, None)
                native.rasterize_surfels(discs, values, camera, blending, camera.depth_range, layer, rows, *texture)
            shader.shade_pixels(camera, rows, layers)

    parallel_rows(draw_strips, STRIPS, smallest=2, parts=STRIPS)


def fill_holes(values: np.ndarray, neighbors: np.ndarray) -> np.ndarray:
    """Values (M, C) of all surfels with these neighbors (M, K), from those of the points (N, C).

    Surfels that close holes get the mean of the nearest points, which lie at the rim.
    """
    rim = neighbors[len(values) :, :HOLE_RIM_POINTS]
    return np.concatenate([values, values[rim].mean(axis=1)])
