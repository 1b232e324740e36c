"""A rough rendering of the bare cloud: surfels under the scene's light, and the shadow that they cast on the floor.

Each point becomes a disc in its tangent plane (after Zwicker et al., Surface Splatting, 2001), clipped where the
surface turns away. No surface is reconstructed: normals are only turned to face the viewer. The network thus receives
shading and shadow in place, rather than three numbers for the light, and makes a clean image of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import GBuffer, PointColors, PreparedCloud
from z2p_core.linalg import rotate_points
from z2p_core.parallel import parallel_rows, run_async
from z2p_core.scene import SceneDescription
from z2p_core.shading.channels import RADIANCE_RGB, RASTERIZED, GBufferChannel
from z2p_core.shading.floor_occlusion import FloorOcclusion, floor_occlusion, is_sparse, shadow_casters
from z2p_core.shading.floor_shadow import cloud_radiance_from_floor, draw_floor_shadow
from z2p_core.shading.light_transport import (
    BouncedLight,
    LightField,
    LightScene,
    Quality,
    base_color,
    begin_floor_visibility,
    begin_point_visibility,
    bounce_light,
    direct_radiance,
)
from z2p_core.shading.surfels import make_surfels
from z2p_core.shading.textured_light import surface_albedo, textured_radiance
from z2p_core.surface.normals import SurfacePoints, estimate_surface
from z2p_core.surface.subsampling import MAX_SURFACE_POINTS, subsample_hashed
from z2p_core.surface.viewer_facing import face_viewer, line_direction
from z2p_renderer.plugins.gbuffers._detail import Detail, DetailShader, visible_detail

BLENDING = native.Blending(blend_depth_radii=0.7, coverage_gain=15.0, full_weight=2.7)
"""Coverage is low where only a disc's rim is; density is 1 within a surface and about a third of that at its border."""
MIN_SPACING = 1e-3
"""Smallest spacing of a cloud that counts, in world units."""
SPARSE_QUANTILE, SPARSE_SPACING_SHARE = 0.9, 0.6
"""Light takes the cloud's spacing to be at least this share of this quantile of its points' spacings."""
ONE_SET_MAX_SIDE = 600
"""Longer side of an image up to which one set of light samples casts the floor's shadow, in pixels."""
TWO_SETS_MAX_SIDE = 900
"""Side up to which two sets do; for larger images there are four, as the steps in a penumbra grow with the image."""
HOLE_RIM_POINTS = 4
"""Points at the rim of a hole whose mean color its surfel gets."""
GREY_ALBEDO = 0.5
"""Albedo of the grey radiance: it stays below white under the nearest light."""
MIN_RADIANCE = 1e-4
"""Added to radiances before they are divided by each other, so that the darkest places keep a ratio near 1."""
STRIPS = 6
"""Strips of an image that the cores rasterize in turn. One core draws the same strips: surfels are culled within each
strip, so that other strips would change a few pixels near their borders."""

PIXEL_AREA_PER_POINT = 3.6
"""Square of the distance between neighboring points, over the number of covered pixels for each point."""
MAX_BLEND_SPACING = 5.0
"""Distance between neighboring points, in pixels, from which on the network's image is left as it is."""
BLEND_SHARE_PER_PIXEL, MAX_BLEND_SHARE = 0.15, 0.6
"""Share of the surfels' colors in the final image for each pixel less than that, and its maximum."""
MAX_COLOR_SHIFT = 8 / 255
"""Largest difference between the two that is taken for noise: larger ones are corrections by the network."""
SHADOW_BLEND_SHARE = 0.25
"""Share of the cast shadow in the final image."""
MAX_SHADOW_SHIFT = 0.06
"""Largest difference in alpha between the cast shadow and the network's at which that share counts in full."""
NETWORK_SHADOW_ALPHA = 0.15
"""Alpha of the cast shadow from which on the network has to draw it; fainter shadow is shown as it was cast."""
MIN_CAST_SHADOW_POINTS = 4000
"""Points of a cloud below which the network draws all shadow, as the cast one has gaps."""


class Shader(Protocol):
    """What a G-buffer's surface looks like under a given light."""

    def surfel_values(self, viewer: np.ndarray) -> list[np.ndarray]:
        """Values of each point for the layers to be rasterized.

        The first layer's are radiances (N, 4) in sRGB towards the viewer (3,): grey, then in the surface's material.
        Each further layer has five values (N, 5).
        """

    def shade_pixels(self, camera: Camera, rows: tuple[int, int], layers: list[np.ndarray]) -> None:
        """Completes the radiance in rows [first, last) of the first layer (9, H, W), after all have been rasterized."""


class MaterialShader(Shader, Protocol):
    """A shader of a surface in the scene's base color, which knows what other colors would change."""

    def total_albedo(self, albedo: np.ndarray) -> np.ndarray:
        """Share (N, 3) of light that points with these base colors (N, 3) send on, reflections included."""

    def relative_radiance(self, viewer: np.ndarray, radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Radiance towards the viewer of points with other base colors, over that of the shader's own surface.

        It is linear in the base color: the offset (N, 3) and the slope (N, 3). `radiance` (N, 3) is that of white
        points amid the colored ones.
        """


@dataclass(frozen=True)
class DiffuseShader:
    """A diffuse surface of one color: its radiance is the same from everywhere."""

    light: LightField
    color: np.ndarray

    def surfel_values(self, viewer: np.ndarray) -> list[np.ndarray]:
        albedo = np.array([GREY_ALBEDO, *self.color], dtype=np.float32)
        return [srgb_from_linear(np.clip(albedo * self.light.bounced.radiance(albedo), 0, 1))]

    def shade_pixels(self, camera: Camera, rows: tuple[int, int], layers: list[np.ndarray]) -> None:
        """Nothing: what surfels show of it is all there is."""

    def total_albedo(self, albedo: np.ndarray) -> np.ndarray:
        return albedo

    def relative_radiance(self, viewer: np.ndarray, radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        neutral = np.asarray(self.color, np.float32)
        received = self.light.bounced.radiance(neutral)
        slope = (radiance + MIN_RADIANCE) / (np.maximum(neutral, MIN_RADIANCE) * (received + MIN_RADIANCE))
        return np.zeros_like(slope), slope


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


class Surfels(GBuffer):
    """Ten channels (`z2p_core.shading.channels.GBufferChannel`): coverage, density, depth, normal, radiance, shadow.

    Light is the area light's, the sky's, what the lit floor sends back, and what parts of the cloud send to each other
    and to the floor.
    """

    name = "surfels"
    version = "11"
    channels = len(GBufferChannel)
    draws_textures = True
    quality: ClassVar[Quality] = Quality()

    def draw(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        features = np.empty((self.channels, camera.height, camera.width), dtype=np.float32)
        self.draw_into(features, cloud, camera, scene)
        return features

    def draw_into(self, out: np.ndarray, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> None:
        self._draw(out, cloud, camera, scene, None)

    def draw_textured_into(
        self, out: np.ndarray, cloud: np.ndarray, colors: PointColors, camera: Camera, scene: SceneDescription
    ) -> np.ndarray:  # fmt: skip
        relative = np.zeros((4, camera.height, camera.width), np.float32)
        self._draw(out, cloud, camera, scene, Texture(colors, relative[:3]))
        relative[3] = out[GBufferChannel.COVERAGE]
        return relative

    def prepare(self, cloud: np.ndarray, colors: PointColors | None = None) -> PreparedCloud:
        if not len(cloud):
            return super().prepare(cloud, colors)
        from z2p_renderer.plugins.gbuffers._prepared_surfels import PreparedSurfels  # late: it is built on this module

        geometry = self.make_geometry(cloud)
        if line_direction(geometry.surface.points) is not None:  # whose normals depend on the camera
            return super().prepare(cloud, colors)
        return PreparedSurfels(self, cloud, geometry, colors)

    def _draw(
        self, out: np.ndarray, cloud: np.ndarray, camera: Camera, scene: SceneDescription, texture: Texture | None
    ) -> None:  # fmt: skip
        """The whole pass, in the order in which its steps need each other's results.

        A second core finds out which points see which while this one makes surfels and casts shadows, and draws the
        floor's shadow while this one shades and rasterizes.
        """
        if not len(cloud):
            out.fill(0)
            return
        quality = self.quality
        surface, spacing = self.estimate(cloud)
        floor_height = float(cloud[:, 2].min()) if scene.floor is None else scene.floor
        normals = face_viewer(surface.points, surface.normals, camera.position)
        lit = light_scene(surface, normals, spacing, scene, floor_height)
        point_visibility = begin_point_visibility(lit, quality)
        floor_visibility = begin_floor_visibility(lit, quality)

        geometry = SurfelGeometry(surface, spacing, *make_surfels(surface, spacing))
        casters = self.casters(geometry, lit.spacing)
        direct = direct_radiance(lit, casters)
        occlusion = self.occlude_floor(lit, casters, light_sample_sets(camera))
        colors = None if texture is None else texture.colors
        detail = visible_detail(cloud, surface, spacing, camera, colors)
        discs = project_surfels(geometry, detail, camera)
        seen = SeenPoints(point_visibility.result(), floor_visibility.result())
        bounced = bounce_light(lit, direct, occlusion, seen.by_points, seen.by_floor, quality)
        albedo = None if colors is None else surface_albedo(surface, colors)
        field = LightField(lit, direct, occlusion, bounced)
        self.draw_lit(out, geometry, detail, discs, field, seen, camera, scene, albedo, None if texture is None else
                      texture.relative)  # fmt: skip

    def estimate(self, cloud: np.ndarray) -> tuple[SurfacePoints, float]:
        """The surface of a cloud (N, 3), N >= 1, and its median spacing."""
        surface = estimate_surface(subsample_hashed(cloud, MAX_SURFACE_POINTS), self.quality.use_normal_gnn)
        return surface, max(float(np.median(surface.spacing)), MIN_SPACING)

    def make_geometry(self, cloud: np.ndarray) -> SurfelGeometry:
        """All of a cloud (N, 3), N >= 1, that depends neither on the camera nor on the light."""
        surface, spacing = self.estimate(cloud)
        return SurfelGeometry(surface, spacing, *make_surfels(surface, spacing))

    def casters(self, geometry: SurfelGeometry, spacing: float) -> native.ShadowCasters:
        """What casts the shadows of the geometry, where light takes its spacing to be that."""
        points, use_discs = geometry.surface.points, self.quality.use_disc_shadows and is_sparse(spacing)
        return shadow_casters(points, spacing, geometry.surfels, geometry.radii, use_discs)

    def occlude_floor(
        self, lit: LightScene, casters: native.ShadowCasters, sets: int, sky: np.ndarray | None = None
    ) -> FloorOcclusion:  # fmt: skip
        """How much light the points hide from the floor; `sky`, if given, is the sky's, of another light's result."""
        use_discs = self.quality.use_disc_shadows and is_sparse(lit.spacing)
        return floor_occlusion(
            lit.points, lit.spacing, casters, lit.light, lit.floor.height, sets, use_discs,
            self.quality.floor_sky_directions, sky,
        )  # fmt: skip

    def draw_lit(
        self, out: np.ndarray, geometry: SurfelGeometry, detail: Detail | None, discs: native.Discs, field: LightField,
        seen: SeenPoints, camera: Camera, scene: SceneDescription, albedo: np.ndarray | None,
        colors_out: np.ndarray | None,
    ) -> None:  # fmt: skip
        """The last phase: shades and draws discs whose light is known, and the floor's shadow on the second core.

        The discs are the geometry's, or those of a dense cloud's `detail`. With an `albedo` (N, 3) of the geometry's
        points, the relative radiance is drawn into `colors_out` (3, H, W).
        """
        lit, bounced = field.scene, field.bounced
        neighbors = (geometry if detail is None else detail).surfels.neighbors
        color = base_color(scene) if albedo is None else albedo
        shadow = run_async(self._draw_shadow, lit, field.occlusion, bounced, seen.by_floor, camera, color, out)
        shader = self.shader(field, scene)
        if detail is not None:
            shader = DetailShader(shader, detail, geometry.surface, field, seen.by_points, self.quality, camera)
        if albedo is None:
            rasterize(discs, neighbors, shader, camera, out[RASTERIZED])
        else:
            sent = shader.total_albedo(albedo)
            radiance = textured_radiance(lit, bounced, sent, seen.by_points, seen.by_floor, self.quality)
            relative = shader.relative_radiance(camera.position, radiance)
            own = albedo if detail is None or detail.albedo is None else detail.albedo
            values = (fill_holes(value, neighbors) for value in (own, *relative))
            textures = native.fit_disc_textures(discs, neighbors, *values)
            rasterize(discs, neighbors, shader, camera, out[RASTERIZED], textures, colors_out)
        shadow.result()

    def shader(self, light: LightField, scene: SceneDescription) -> MaterialShader:
        """What the surface looks like in that light."""
        return DiffuseShader(light, base_color(scene))

    def _draw_shadow(
        self, lit: LightScene, occlusion: FloorOcclusion, bounced: BouncedLight, floor_visibility: np.ndarray,
        camera: Camera, color: np.ndarray, out: np.ndarray,
    ) -> None:  # fmt: skip
        """Draws the channel `SHADOW` of `out`; the floor mirrors the cloud in its linear base color (3,) or (N, 3)."""
        radiance = cloud_radiance_from_floor(bounced, floor_visibility, color)
        directions = self.quality.mirror_directions
        draw_floor_shadow(lit, occlusion, radiance, directions, camera, out[GBufferChannel.SHADOW])

    def elsewhere(self, features: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray] | None:
        if points < MIN_CAST_SHADOW_POINTS:
            return None
        shadow = features[GBufferChannel.SHADOW]
        floor = np.zeros((4, *features.shape[1:]), np.float32)
        floor[3] = shadow
        return features[GBufferChannel.COVERAGE] + (shadow > NETWORK_SHADOW_ALPHA), floor

    def rough_picture(self, features: np.ndarray) -> np.ndarray:
        coverage, shadow = features[GBufferChannel.COVERAGE], features[GBufferChannel.SHADOW]
        return np.concatenate([coverage * features[RADIANCE_RGB], (coverage + (1 - coverage) * shadow)[None]])

    def reconcile(self, picture: np.ndarray, features: np.ndarray, points: int) -> None:
        coverage, shadow = features[GBufferChannel.COVERAGE], features[GBufferChannel.SHADOW]
        pixel_spacing = math.sqrt(PIXEL_AREA_PER_POINT * float(coverage.sum()) / max(points, 1))
        share = min(BLEND_SHARE_PER_PIXEL * (MAX_BLEND_SPACING - pixel_spacing), MAX_BLEND_SHARE)
        if share > 0:
            native.blend_towards(picture, coverage, features[RADIANCE_RGB], share, MAX_COLOR_SHIFT)
        native.blend_shadow_towards(picture[3], coverage, shadow, SHADOW_BLEND_SHARE, MAX_SHADOW_SHIFT)


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
    textures: np.ndarray | None = None, colors_out: np.ndarray | None = None,
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
                native.rasterize_surfels(discs, values, camera, BLENDING, camera.depth_range, layer, rows, *texture)
            shader.shade_pixels(camera, rows, layers)

    parallel_rows(draw_strips, STRIPS, smallest=2, parts=STRIPS)


def fill_holes(values: np.ndarray, neighbors: np.ndarray) -> np.ndarray:
    """Values (M, C) of all surfels with these neighbors (M, K), from those of the points (N, C).

    Surfels that close holes get the mean of the nearest points, which lie at the rim.
    """
    rim = neighbors[len(values) :, :HOLE_RIM_POINTS]
    return np.concatenate([values, values[rim].mean(axis=1)])
