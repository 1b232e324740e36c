"""The rough rendering for glossy surfaces: reflections of the area light, the sky, the lit floor and the cloud itself.

A surface is Blender's Principled BSDF (`z2p_core.shading.principled`). Three kinds of reflection are added to the
diffuse light of `surfels`:

- the area light: GGX over samples of it, or, on surfaces so smooth that gaps between the samples would show, its sharp
  image with blurred edges;
- the sky and the floor: one lookup along the specular lobe's dominant direction, blurred at the horizon;
- other parts of the cloud: one ray to the surfels' discs. It stands for the whole lobe, so the rougher the surface, the
  more of the diffuse light around is used instead.

Highlights may be smaller than the distance between points. So, where the surfels of a pixel have similar normals, the
reflections of light, sky and floor are computed again for the pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.images import srgb_from_linear
from z2p_core.linalg import dot_axis, row_dots
from z2p_core.placement.placed_camera import PlacedCamera
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, SceneDescription
from z2p_core.shading.area_light import area_light_quad, area_light_samples
from z2p_core.shading.channels import RADIANCE_RGB, STEADY_RGB, GBufferChannel, MaterialChannel
from z2p_core.shading.light_transport import LightField, base_color
from z2p_core.shading.microfacet import alpha_from_roughness
from z2p_core.shading.principled import IOR, Principled
from z2p_renderer.plugins.gbuffers.surfels import GREY_ALBEDO, MIN_RADIANCE, MaterialShader, Surfels

SPECULAR_LIGHT_SAMPLES = 36
"""Samples of the area light for its reflection, a square number."""
MIN_SAMPLED_ALPHA = 0.04
"""Least alpha whose lobe is so wide that these samples leave no gaps; smoother surfaces show the light's image."""
IMAGE_BLUR_PER_ALPHA = 1.7
"""Blur of that image for each unit of alpha: half of the light then stays as near as in the GGX lobe."""
MIN_IMAGE_ALPHA = 0.02
"""Least alpha that it is blurred with, as the normals are not more accurate."""
MIN_LOBE_ALPHA = 1e-3
"""Least alpha of the lobe that samples sky and floor."""
MAX_LOBE_SHARPNESS = 150.0
"""Largest sharpness of that lobe: it blurs the horizon at least this much."""
HORIZON_SLOPE = 2.4
"""Slope of the logistic curve with which the lobe's share above the horizon rises, per width of the lobe."""
LOBE_TILT = 0.6
"""Tilt of the lobe's axis towards the normal, over that of the formula in `dominant_directions`: fitted to
metal balls."""
DIFFUSE_BLEND_ROUGHNESS = (0.1, 1.0)
"""Roughness at which the surroundings begin to be reflected as by a diffuse surface, and at which they are in full."""
SPECULAR_BOUNCES = 1
"""Reflections of the cloud in itself that are followed from the viewer on."""
RAYCAST_RADIUS_SPACINGS = 1.2
"""Radius of the discs that reflected rays meet, in spacings: of random points they leave 0.01 of the surface open."""
N_DOT_V_EPSILON = 1e-3
"""Smallest cosine between normal and view that albedos and reflected directions are computed with: on estimated normals
it may be 0 or below. The GGX kernel, which divides by it, has a larger limit (`MIN_N_DOT_V` in `ggx_specular.c`)."""
NORMAL_COHERENCE = (0.9, 0.98)
"""Length of the mean normal in a pixel up to which its reflections are those of its surfels (as at creases), and from
which on they are computed for the pixel; between the two they are blended."""


@dataclass(frozen=True)
class OutgoingRadiance:
    """What M points send to a viewer, without their reflections of light, sky and floor."""

    steady: np.ndarray
    """Linear radiance (M, 3), which varies little over a surfel."""
    light_visibility: np.ndarray
    """Visible fraction (M,) of the area light, in [0, 1]."""
    mirror_visibility: np.ndarray
    """Visible fraction (M,) of the mirrored sky and floor, less what is reflected as by a diffuse surface."""


@dataclass(frozen=True)
class PrincipledShader:
    """A surface with reflections. Arrays (M, 3) of points, unit normals and unit directions to the viewer (`view`)."""

    light: LightField
    surface: Principled

    def surfel_values(self, viewer: np.ndarray) -> list[np.ndarray]:
        """Radiances (N, 4) in sRGB, grey and diffuse, then with reflections; and what `shade_pixels` needs (N, 5)."""
        points = self.light.scene.points
        rows = np.arange(len(points))
        outgoing, radiance = self.outgoing_radiance(
            rows, np.zeros_like(rows), directions_to(viewer, points), SPECULAR_BOUNCES
        )  # fmt: skip
        grey = GREY_ALBEDO * self.light.bounced.radiance(np.array([GREY_ALBEDO]))
        values = np.column_stack([outgoing.steady, outgoing.light_visibility, outgoing.mirror_visibility])
        return [to_srgb(np.column_stack([grey, radiance])), values]

    def total_albedo(self, albedo: np.ndarray) -> np.ndarray:
        return replace(self.surface, color=albedo).albedo

    def relative_radiance(self, viewer: np.ndarray, radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The base color scales the diffuse part and a metal's reflections, not a dielectric's."""
        scene, surface = self.light.scene, self.surface
        rows = np.arange(len(scene.points))
        view = directions_to(viewer, scene.points)
        n_dot_v = np.maximum(row_dots(scene.normals, view), N_DOT_V_EPSILON)
        total = self.outgoing_radiance(rows, np.zeros_like(rows), view, 0)[1]
        diffuse = self.light.bounced.radiance(surface.albedo) * surface.diffuse_albedo(n_dot_v)
        specular = np.maximum(total - diffuse, 0)
        received = self.light.bounced.radiance(surface.albedo)
        metallic = specular * surface.metal_share(n_dot_v)
        tinted = diffuse * (radiance + MIN_RADIANCE) / (received + MIN_RADIANCE) + metallic
        neutral = diffuse + specular + MIN_RADIANCE
        slope = tinted / (np.maximum(surface.color, MIN_RADIANCE) * neutral)
        return (specular - metallic + MIN_RADIANCE) / neutral, slope

    def shade_pixels(self, camera: Camera, rows: tuple[int, int], layers: list[np.ndarray]) -> None:
        """Computes the reflections of light, sky and floor in each pixel whose surfels have similar normals."""
        drawn, material = (layer[:, slice(*rows)] for layer in layers)
        covered = drawn[GBufferChannel.COVERAGE] > 0
        averaged, material = drawn[:, covered], material[:, covered]
        normals = np.stack([averaged[GBufferChannel.NORMAL_RIGHT], averaged[GBufferChannel.NORMAL_DOWN],
                            material[MaterialChannel.NORMAL_FORWARD]], axis=1)  # fmt: skip
        coherence = np.linalg.norm(normals, axis=1)
        normals = (normals / np.maximum(coherence, 1e-6)[:, None]) @ camera.rotation.astype(np.float32)
        points = pixel_positions(averaged[GBufferChannel.DEPTH], covered, camera, rows[0])
        seen = (points, normals, directions_to(camera.position, points))
        outgoing = OutgoingRadiance(
            material[STEADY_RGB].T, material[MaterialChannel.LIGHT_VISIBILITY],
            material[MaterialChannel.MIRROR_VISIBILITY],
        )  # fmt: skip
        radiance = outgoing.steady + self.reflected_radiance(*seen, outgoing, self.light_reflection(*seen))
        low, high = NORMAL_COHERENCE
        share = np.clip((coherence - low) / (high - low), 0, 1)
        drawn[RADIANCE_RGB, covered] += share * (to_srgb(radiance).T - averaged[RADIANCE_RGB])

    def outgoing_radiance(
        self, rows: np.ndarray, sides: np.ndarray, view: np.ndarray, bounces: int
    ) -> tuple[OutgoingRadiance, np.ndarray]:  # fmt: skip
        """What the points of these rows (M,) send in directions `view` (M, 3), on these sides; and radiance (M, 3).

        `sides` (M,) is 0 for the side that the normal points to, 1 for the other. Light is followed back over
        `bounces` reflections. In the last one the floor right below the object is left out, since the object itself
        would hide the sky from it.
        """
        scene, field = self.light.scene, self.light
        points = scene.points[rows]
        normals = scene.normals[rows] * np.where(sides, -1, 1).astype(np.float32)[:, None]
        n_dot_v = np.maximum(row_dots(normals, view), N_DOT_V_EPSILON)
        reflected = 2 * n_dot_v[:, None] * normals - view
        direct = field.direct[sides, rows]
        mirror_visibility = np.full(len(rows), 1 - self.diffuse_blend, np.float32)
        if not bounces:
            lobes = dominant_directions(reflected, normals, self.surface.roughness)
            mirror_visibility *= 1 - self.hidden_floor_share(points, lobes)
        diffuse = field.bounced.radiance(self.surface.albedo, sides, rows)
        surroundings = (diffuse - direct[:, None]) * (1 - mirror_visibility)[:, None]
        if bounces and self.diffuse_blend < 1:
            self.add_reflected_parts(surroundings, mirror_visibility, rows, reflected, bounces - 1)
        steady = diffuse * self.surface.diffuse_albedo(n_dot_v) + surroundings * self.surface.specular_albedo(n_dot_v)
        ggx_terms, unshadowed = self.sampled_light_reflection(points, normals, view)
        light_visibility = np.clip(direct / np.maximum(unshadowed, 1e-4), 0, 1)
        outgoing = OutgoingRadiance(steady, light_visibility, mirror_visibility)
        if self.shows_light_image:
            ggx_terms = self.light_reflection(points, normals, view)
        return outgoing, steady + self.reflected_radiance(points, normals, view, outgoing, ggx_terms)

    def add_reflected_parts(
        self, surroundings: np.ndarray, mirror_visibility: np.ndarray, rows: np.ndarray, rays: np.ndarray, bounces: int
    ) -> None:
        """Adds what reflected rays (M, 3) from the points `rows` meet of the cloud to `surroundings` (M, 3), in place.

        One ray stands for a lobe: the rougher the surface, the more of what was there, and of `mirror_visibility`
        (M,), stays.
        """
        scene = self.light.scene
        radius = RAYCAST_RADIUS_SPACINGS * scene.spacing
        hits = native.raycast_discs(scene.points, scene.normals, rows, rays, radius, scene.spacing, scene.radius)
        hitting = np.flatnonzero(hits >= 0)
        others, view = hits[hitting], -rays[hitting]
        sides = (row_dots(scene.normals[others], view) < 0).astype(np.intp)
        surroundings[hitting] *= self.diffuse_blend
        radiance = self.outgoing_radiance(others, sides, view, bounces)[1]
        surroundings[hitting] += (1 - self.diffuse_blend) * radiance
        mirror_visibility[hitting] *= self.diffuse_blend

    def sampled_light_reflection(
        self, points: np.ndarray, normals: np.ndarray, view: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """The GGX terms (M, 3) of the unshadowed area light, and the radiance (M,) of a white diffuse surface there.

        See `z2p_core.native.specular_radiance`.
        """
        positions, axes, powers = area_light_samples(self.light.scene.light, SPECULAR_LIGHT_SAMPLES)
        alpha = alpha_from_roughness(self.surface.roughness, MIN_SAMPLED_ALPHA)
        return native.specular_radiance(points, normals, view, positions, axes[0], float(powers[0]), alpha, IOR)

    def light_reflection(self, points: np.ndarray, normals: np.ndarray, view: np.ndarray) -> np.ndarray:
        """The GGX terms (M, 3) of the unshadowed area light: sampled, or those of its image on smooth surfaces."""
        if not self.shows_light_image:
            return self.sampled_light_reflection(points, normals, view)[0]
        blur = IMAGE_BLUR_PER_ALPHA * alpha_from_roughness(self.surface.roughness, MIN_IMAGE_ALPHA)
        quad = area_light_quad(self.light.scene.light)
        return native.sharp_light_reflection(points, normals, view, quad, LIGHT_RADIANCE, blur, IOR)

    def reflected_radiance(
        self, points: np.ndarray, normals: np.ndarray, view: np.ndarray, outgoing: OutgoingRadiance,
        ggx_terms: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Radiance (M, 3) of the reflections of light, sky and floor."""
        n_dot_v = np.maximum(row_dots(normals, view), N_DOT_V_EPSILON)
        reflected = 2 * n_dot_v[:, None] * normals - view
        lobes = dominant_directions(reflected, normals, self.surface.roughness)
        environment = self.environment_radiance(points, lobes) * outgoing.mirror_visibility
        highlight = self.surface.specular_radiance(outgoing.light_visibility[:, None] * ggx_terms, n_dot_v)
        return highlight + environment[:, None] * self.surface.specular_albedo(n_dot_v)

    def environment_radiance(self, points: np.ndarray, lobes: np.ndarray) -> np.ndarray:
        """Mean radiance (M,) of sky and lit floor in lobes about directions (M, 3) from points (M, 3)."""
        sky_share, downwards = self.split_at_horizon(lobes)
        floor = self.light.scene.floor
        positions, light_hidden, sky_hidden = self.intersect_floor(points, downwards)
        to_light = floor.light_positions.mean(0) - positions
        squared = (to_light**2).sum(1)
        cos_light = np.maximum(-dot_axis(to_light, floor.light_axis), 0)  # times the distance, as is the floor's cosine
        lit = floor.light_power * cos_light * to_light[:, 2] / (squared * squared * math.pi)
        floor_radiance = floor.albedo * (lit * (1 - light_hidden) + floor.sky_radiance * (1 - sky_hidden))
        radiance: np.ndarray = AMBIENT * sky_share + floor_radiance * (1 - sky_share)
        return radiance

    def hidden_floor_share(self, points: np.ndarray, lobes: np.ndarray) -> np.ndarray:
        """Share (M,) of lobes about directions (M, 3) from points (M, 3) that meets floor which sees no sky."""
        sky_share, downwards = self.split_at_horizon(lobes)
        share: np.ndarray = (1 - sky_share) * self.intersect_floor(points, downwards)[2]
        return share

    def split_at_horizon(self, lobes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Share (M,) of lobes about directions (M, 3) above the horizon, and mean directions (M, 3) of the rest."""
        width = 1 / math.sqrt(lobe_sharpness(self.surface.roughness))
        downwards = lobes.copy()
        downwards[:, 2] = -width * np.logaddexp(0, -lobes[:, 2] / width)
        downwards /= np.linalg.norm(downwards, axis=1, keepdims=True)
        return 1 / (1 + np.exp(-HORIZON_SLOPE / width * lobes[:, 2])), downwards

    def intersect_floor(self, points: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where rays (M, 3) down from points (M, 3) meet the floor (M, 3), and its occlusion (M,) of light and sky."""
        floor, occlusion = self.light.scene.floor, self.light.occlusion
        cells = len(occlusion.light)
        distance = (floor.height - points[:, 2]) / np.minimum(rays[:, 2], -1e-3)
        positions = points + distance[:, None] * rays
        column, row = ((positions[:, axis] + floor.half_size) * cells / (2 * floor.half_size) for axis in (0, 1))
        inside = (column >= 0) & (row >= 0) & (column < cells) & (row < cells)
        cell = (np.where(inside, row, 0).astype(np.intp), np.where(inside, column, 0).astype(np.intp))
        light_hidden, sky_hidden = (np.where(inside, hidden[cell], 0) for hidden in occlusion)
        return positions, light_hidden, sky_hidden

    @property
    def shows_light_image(self) -> bool:
        """Whether the surface is so smooth that it shows the light's sharp image."""
        return alpha_from_roughness(self.surface.roughness) < MIN_SAMPLED_ALPHA

    @cached_property
    def diffuse_blend(self) -> float:
        """Share in [0, 1] of the surroundings that is reflected as by a diffuse surface."""
        return diffuse_blend(self.surface.roughness)


class Glossy(Surfels):
    """The channels of `Surfels`, with the material's reflections in the three channels of its own radiance."""

    name = "glossy"
    version = "12"
    refines = "surfels"

    def shader(self, light: LightField, scene: SceneDescription) -> MaterialShader:
        metallic, specular = (
            _material_number(scene, "Metallic", 0.0),
            _material_number(scene, "Specular IOR Level", 0.0),
        )
        roughness = _material_number(scene, "Roughness", 1.0)
        return PrincipledShader(light, Principled(base_color(scene), metallic, specular, roughness))


def directions_to(viewer: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Unit directions (M, 3) float32 from points (M, 3) to the viewer (3,)."""
    view = viewer.astype(np.float32) - points
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    return view


def to_srgb(radiance: np.ndarray) -> np.ndarray:
    """Linear radiance as sRGB in [0, 1], float32, same shape."""
    return srgb_from_linear(np.clip(radiance, 0, 1)).astype(np.float32)


def dominant_directions(reflected: np.ndarray, normals: np.ndarray, roughness: float) -> np.ndarray:
    """Unit axes (M, 3) of specular lobes: mirrored directions (M, 3), tilted to the normals (M, 3) by roughness.

    After Lagarde and de Rousiers, Moving Frostbite to Physically Based Rendering, 2014, scaled by `LOBE_TILT`.
    """
    tilt = LOBE_TILT * (1 - (1 - roughness) * (math.sqrt(1 - roughness) + roughness))
    axes = reflected + np.float32(tilt) * (normals - reflected)
    axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-6)
    return axes


def lobe_sharpness(roughness: float) -> float:
    """Sharpness of the spherical Gaussian near a specular lobe (Wang et al., All-Frequency Rendering, 2009)."""
    return min(0.5 + 0.5 / alpha_from_roughness(roughness, MIN_LOBE_ALPHA) ** 2, MAX_LOBE_SHARPNESS)


def diffuse_blend(roughness: float) -> float:
    """How far surroundings are reflected as by a diffuse surface, in [0, 1]: a smooth step in the roughness."""
    low, high = DIFFUSE_BLEND_ROUGHNESS
    share = min(max((roughness - low) / (high - low), 0.0), 1.0)
    return share * share * (3 - 2 * share)


def pixel_positions(depth: np.ndarray, covered: np.ndarray, camera: Camera, top: int) -> np.ndarray:
    """World positions (M, 3) float32 of the covered pixels of (h, W) bool, in rows from `top` on.

    `depth` (M,) is their channel `DEPTH`.
    """
    row, column = np.nonzero(covered)
    near, far = camera.depth_range
    z = far - (far - near) * depth
    if isinstance(camera, PlacedCamera):
        return camera.unproject(np.column_stack([column + 0.5, row + top + 0.5]), z).astype(np.float32)
    x = (column + 0.5 - camera.width / 2) / camera.focal * z
    y = (row + top + 0.5 - camera.height / 2) / camera.focal * z
    positions: np.ndarray = np.stack([x, y, z], axis=1) @ camera.rotation + camera.position
    return positions.astype(np.float32)


def _material_number(scene: SceneDescription, name: str, default: float) -> float:
    """A number of the scene's material; the default where there is none."""
    value = scene.material.get(name, default)
    return float(value) if isinstance(value, int | float) else default
