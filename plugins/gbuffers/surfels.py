"""A rough rendering of the bare cloud: surfels lit through shadow maps, and the shadow that they cast on the floor.

Each point becomes a small disc in the plane through its neighbours (after Zwicker et al., Surface Splatting, 2001),
which ends where the surface turns away. Nothing is solved for: normals are only turned to the viewer. What the network
would have to imagine from light's three numbers alone, where shade and shadow fall, is here in its place; the network
makes a clean picture of it.
"""

from __future__ import annotations

import math
from functools import partial
from typing import ClassVar

import numpy as np

from z2p_core import native
from z2p_core.camera import DEPTH_RANGE, Camera
from z2p_core.interfaces import GBuffer
from z2p_core.linalg import row_dots, rotate_points
from z2p_core.parallel import run_async, parallel_rows
from z2p_core.scene import SceneDescription
from z2p_core.shading.channels import RADIANCE_RGB, RASTERIZED, GBufferChannel
from z2p_core.shading.light_transport import Quality, Lighting
from z2p_core.shading.surfels import make_surfels
from z2p_core.surface.normals import MOST_POINTS, tangents, thinned

SLACK = 0.7
"""How far behind the nearest disc another still counts, in radii."""
SPARSE = 0.6
"""Light takes the cloud for as sparse as so much of the spacing that a tenth of the points exceed, if that is more."""
SURE, FULL = 15.0, 2.7
"""Of coverage: what discs only touch with their rim stays in doubt. Of density: what discs of that radius add up to
where they lie all around; about a third of it is the surface's border."""
SMALL, MIDDLING = 600, 900
"""Sides of pictures, in pixels, up to which such lamps stand over the floor once, and twice; over larger ones four
times, for the steps that they leave in a penumbra grow with the picture."""
STRAIGHT = 1e-5
"""Width of a cloud, in its length, up to which it is a line, whose patches could face any way across it."""
HOLE_RIM = 4
"""Points at the rim of a hole whose mean colour it gets."""
APART = 3.6
"""Square of the distance from point to point, in covered pixels for each point."""
SPARSE_APART, TRUST, MOST_TRUST = 5.0, 0.15, 0.6
"""Pixels from point to point from which on the network's picture stays as it is; and the share that the discs' colours
have in it for each pixel less, and at most."""
ALIKE = 8 / 255
"""How far the network's colour and a disc's differ by chance, at most: by more where the network mends something."""
SHADOW_TRUST, SHADOW_ALIKE = 0.25, 0.06
"""Share that the floor's shadow as it is cast here has in the picture's, where they differ by no more."""
SHADED = 0.15
"""Alpha of the floor's shadow from which on the network is needed for it: fainter, it is as good as it is cast."""
FEWEST_SURE = 4000
"""Points from which on that holds: the shadow of fewer has gaps, which only the network closes."""
STRIPS = 6
"""Strips of a picture, which the cores take in turn. One core draws the same ones: which discs are hidden is told
within each strip, so with others a few discs near their borders would show, or not."""


class Surfels(GBuffer):
    """Ten channels.

    Coverage; density, a third at a border; depth, 1 near to 0 far; normal to the right and down (2); grey radiance,
    then radiance in the surface's colour (3), sRGB; all of these 0 off the discs. Last the floor shadow's alpha. Light
    is the lamp's, the sky's, what the lit floor sends back, and what parts of the cloud send to each other and the
    floor.
    """

    name = "surfels"
    version = "11"
    channels = len(GBufferChannel)
    lighting: ClassVar[type[Lighting]] = Lighting
    detail: ClassVar[Quality] = Quality()

    def draw(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        picture = np.empty((self.channels, camera.height, camera.width), dtype=np.float32)
        self.draw_into(picture, cloud, camera, scene)
        return picture

    def draw_into(self, out: np.ndarray, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> None:
        if not len(cloud):
            out.fill(0)
            return
        floor = float(cloud[:, 2].min()) if scene.floor is None else scene.floor
        found = tangents(thinned(cloud, MOST_POINTS), self.detail.agreed)
        points, spacing, normals = found.points, found.spacing, faced(found.points, found.normals, camera.position)
        typical = max(float(np.median(spacing)), 1e-3)
        spread = max(typical, SPARSE * float(np.quantile(spacing, 0.9)))
        lighting = self.lighting(points, normals, spread, scene, floor, self.detail)
        found, radii = make_surfels(found, typical)
        lighting.shade(found, radii, lamp_sets_for(camera))
        normals = faced(found.points, found.normals, camera.position)
        rotation = camera.rotation.astype(np.float32)
        facing = rotate_points(normals, rotation)
        centres = native.offset_disc_centers(found.points, normals, radii, found.neighbours)
        seen = rotate_points(centres - camera.position.astype(np.float32), rotation)
        clips = native.disc_clip_planes(seen, facing, radii, found.neighbours)
        lighting.follow()
        shadow = run_async(lighting.draw_shadow, camera, out[GBufferChannel.SHADOW])
        kept = partial(with_holes, neighbours=found.neighbours)
        layers = [np.column_stack([facing[:, :2], kept(lighting.colors(camera.position))])]
        layers += [np.column_stack([facing[:, 2], kept(further)]) for further in lighting.further()]
        pictures = [out[RASTERIZED], *(np.empty_like(out[RASTERIZED]) for _ in layers[1:])]
        draw = partial(native.rasterize_surfels, seen, facing, radii, clips)

        def draw_strips(begin: int, end: int) -> None:
            for strip in range(begin, end):
                rows = (strip * camera.height // STRIPS, (strip + 1) * camera.height // STRIPS)
                for layer, picture in zip(layers, pictures, strict=True):
                    draw(layer, camera, SLACK, SURE, FULL, *DEPTH_RANGE, picture, rows)
                lighting.finish(camera, rows, pictures)

        parallel_rows(draw_strips, STRIPS, smallest=2, parts=STRIPS)
        shadow.result()

    def elsewhere(self, features: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray] | None:
        if points < FEWEST_SURE:
            return None
        shadow = features[GBufferChannel.SHADOW]
        floor = np.zeros((4, *features.shape[1:]), np.float32)
        floor[3] = shadow
        return features[GBufferChannel.COVERAGE] + (shadow > SHADED), floor

    def reconcile(self, picture: np.ndarray, features: np.ndarray, points: int) -> None:
        coverage = features[GBufferChannel.COVERAGE]
        apart = math.sqrt(APART * float(coverage.sum()) / max(min(points, MOST_POINTS), 1))
        trust = min(TRUST * (SPARSE_APART - apart), MOST_TRUST)
        if trust > 0:
            native.reconcile(picture, coverage, features[RADIANCE_RGB], trust, ALIKE)
        native.reconcile_shadow(picture[3], coverage, features[GBufferChannel.SHADOW], SHADOW_TRUST, SHADOW_ALIKE)


def lamp_sets_for(camera: Camera) -> int:
    """How many times lamps stand over the floor for a picture of that size."""
    side = max(camera.width, camera.height)
    return 1 if side <= SMALL else 2 if side <= MIDDLING else 4


def with_holes(colors: np.ndarray, neighbours: np.ndarray) -> np.ndarray:
    """Colours (M, C) of discs with these neighbours (M, K): those of the points (N, C), and in holes of the rim."""
    rim = neighbours[len(colors) :, :HOLE_RIM]
    return np.concatenate([colors, colors[rim].mean(axis=1)])


def line_through(points: np.ndarray) -> np.ndarray | None:
    """The direction (3,) float32 of the line that all points (N, 3) lie on, 0 for one point; None if there is none."""
    if len(points) < 2:
        return np.zeros(3, np.float32)
    apart = (points - points[0]).astype(np.float64)
    squares, axes = np.linalg.eigh(apart.T @ apart)
    return axes[:, 2].astype(np.float32) if squares[1] <= STRAIGHT**2 * squares[2] else None


def faced(points: np.ndarray, normals: np.ndarray, viewer: np.ndarray) -> np.ndarray:
    """Normals (N, 3) of points (N, 3), each turned towards the viewer (3,); on a line, as far as they can turn."""
    line = line_through(points)
    if line is not None:
        towards = viewer.astype(np.float32) - points
        towards -= (towards @ line)[:, None] * line
        return towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-6)
    away = row_dots(points - viewer.astype(np.float32), normals) > 0
    return normals * np.where(away, np.float32(-1), np.float32(1))[:, None]
