"""A rough rendering of the bare cloud: surfels under the scene's light, and the shadow that they cast on the floor.

Each point becomes a disc in its tangent plane (after Zwicker et al., Surface Splatting, 2001), clipped where the
surface turns away. No surface is reconstructed: normals are only turned to face the viewer. The network thus receives
shading and shadow in place, rather than three numbers for the light, and makes a clean image of them.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.interfaces import GBuffer, PointColors, PreparedCloud
from z2p_core.parallel import run_async
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
from z2p_renderer.plugins.gbuffers._detail import Detail, DetailShader, shows_detail, visible_detail
from z2p_renderer.plugins.gbuffers._drawing import (
    BLENDING,
    DETAIL_BLENDING,
    SeenPoints,
    SurfelGeometry,
    Texture,
    fill_holes,
    light_sample_sets,
    light_scene,
    project_surfels,
    rasterize,
)
from z2p_renderer.plugins.gbuffers._prepared_surfels import PreparedSurfels
from z2p_renderer.plugins.gbuffers._shaders import DiffuseShader, MaterialShader

MIN_SPACING = 1e-3
"""Smallest spacing of a cloud that counts, in world units."""
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
        surface, spacing = self.estimate(cloud, not shows_detail(cloud))
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

    def estimate(self, cloud: np.ndarray, is_drawn: bool = True) -> tuple[SurfacePoints, float]:
        """The surface of a cloud (N, 3), N >= 1, and its median spacing; coarser normals do where it is only lit."""
        points = subsample_hashed(cloud, MAX_SURFACE_POINTS)
        if is_drawn:
            surface = estimate_surface(points, self.quality.use_normal_gnn)
        else:
            surface = estimate_surface(points, use_normal_gnn=False, jet_iterations=1)
        return surface, max(float(np.median(surface.spacing)), MIN_SPACING)

    def make_geometry(self, cloud: np.ndarray) -> SurfelGeometry:
        """All of a cloud (N, 3), N >= 1, that depends neither on the camera nor on the light."""
        surface, spacing = self.estimate(cloud, not shows_detail(cloud))
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
        blending = BLENDING if detail is None else DETAIL_BLENDING
        if albedo is None:
            rasterize(discs, neighbors, shader, camera, out[RASTERIZED], blending=blending)
        else:
            sent = shader.total_albedo(albedo)
            radiance = textured_radiance(lit, bounced, sent, seen.by_points, seen.by_floor, self.quality)
            relative = shader.relative_radiance(camera.position, radiance)
            own = albedo if detail is None or detail.albedo is None else detail.albedo
            values = (fill_holes(value, neighbors) for value in (own, *relative))
            textures = native.fit_disc_textures(discs, neighbors, *values)
            rasterize(discs, neighbors, shader, camera, out[RASTERIZED], textures, colors_out, blending)
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
