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
from z2p_core.camera import Camera
from z2p_core.discs import discs
from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import GBuffer
from z2p_core.lamps import floor_sky, light_lamps, light_square, sky_axes
from z2p_core.reflection import mirror_directions
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription
from z2p_core.shades import FLOOR_HALF, casters_of, floor_shades, narrowed_share
from z2p_core.tangents import MOST_POINTS, Tangents, tangents, thinned
from z2p_core.threads import beside, over_rows, rows_beside
from z2p_core.turning import products, turned

SLACK = 0.7
"""How far behind the nearest disc another still counts, in radii."""
SPARSE = 0.6
"""Light takes the cloud for as sparse as so much of the spacing that a tenth of the points exceed, if that is more."""
SURE, FULL = 15.0, 2.7
"""Of coverage: what discs only touch with their rim stays in doubt. Of density: what discs of that radius add up to
where they lie all around; about a third of it is the surface's border."""
NEAR, FAR = 2.6, 4.6
"""Depths of the unit sphere's near and far end."""
LAMPS = 16
"""Points that stand for the area light over the cloud's points, a square number."""
QUARTERS = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) / math.sqrt(12)
"""Places on a square, in its sides from its middle, whose mean is that over all of it for light that changes slowly
(Gauss's quadrature)."""
SMALL, MIDDLING = 600, 900
"""Sides of pictures, in pixels, up to which such lamps stand over the floor once, and twice; over larger ones four
times, for the steps that they leave in a penumbra grow with the picture."""
SKY_DIRECTIONS, BELOW, MIRRORED, GLOW_CELLS = 24, 32, 64, 128
"""Directions that stand for the sky, and those in which the floor sees the cloud and in which it mirrors; and its cells
a side for the light that comes back from the cloud."""
FLOOR_ALBEDO, FLOOR_ROUGHNESS, FLOOR_INDEX = 0.8, 0.5, 1.5
"""Blender's own for a surface without a material, which is a Principled BSDF."""
BOUNCES, MOST_KEPT, SECOND = 2, 0.9, 0.5
"""How often light is followed from point to point and over the floor, what later bounces keep of it at most, and the
share of the second one that the floor has: with it shadows are as dark as in renders of 512 samples."""
GREY = 0.5
"""Albedo of the grey picture, below white under the nearest light."""
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
    channels = 10
    lighting: ClassVar[type[Lighting]]

    def draw(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        picture = np.empty((self.channels, camera.height, camera.width), dtype=np.float32)
        self.draw_into(picture, cloud, camera, scene)
        return picture

    def draw_into(self, out: np.ndarray, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> None:
        if not len(cloud):
            out.fill(0)
            return
        floor = float(cloud[:, 2].min()) if scene.floor is None else scene.floor
        found = tangents(thinned(cloud, MOST_POINTS))
        points, spacing, normals = found.points, found.spacing, faced(found.points, found.normals, camera.position)
        typical = max(float(np.median(spacing)), 1e-3)
        spread = max(typical, SPARSE * float(np.quantile(spacing, 0.9)))
        lighting = self.lighting(points, normals, spread, scene, floor)
        found, radii = discs(found, typical)
        lighting.shade(found, radii, lamp_sets_for(camera))
        normals = faced(found.points, found.normals, camera.position)
        rotation = camera.rotation.astype(np.float32)
        facing = turned(normals, rotation)
        centres = native.centres(found.points, normals, radii, found.neighbours)
        seen = turned(centres - camera.position.astype(np.float32), rotation)
        clips = native.clips(seen, facing, radii, found.neighbours)
        lighting.follow()
        shadow = beside(lighting.draw_shadow, camera, out[-1])
        kept = partial(with_holes, neighbours=found.neighbours)
        layers = [np.column_stack([facing[:, :2], kept(lighting.colors(camera.position))])]
        layers += [np.column_stack([facing[:, 2], kept(further)]) for further in lighting.further()]
        pictures = [out[:-1], *(np.empty_like(out[:-1]) for _ in layers[1:])]
        draw = partial(native.surfels, seen, facing, radii, clips)

        def draw_strips(begin: int, end: int) -> None:
            for strip in range(begin, end):
                rows = (strip * camera.height // STRIPS, (strip + 1) * camera.height // STRIPS)
                for layer, picture in zip(layers, pictures, strict=True):
                    draw(layer, camera, SLACK, SURE, FULL, NEAR, FAR, picture, rows)
                lighting.finish(camera, rows, pictures)

        over_rows(draw_strips, STRIPS, smallest=2, parts=STRIPS)
        shadow.result()

    def elsewhere(self, features: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray] | None:
        if points < FEWEST_SURE:
            return None
        floor = np.zeros((4, *features.shape[1:]), np.float32)
        floor[3] = features[-1]
        return features[0] + (features[-1] > SHADED), floor

    def reconcile(self, picture: np.ndarray, features: np.ndarray, points: int) -> None:
        apart = math.sqrt(APART * float(features[0].sum()) / max(min(points, MOST_POINTS), 1))
        trust = min(TRUST * (SPARSE_APART - apart), MOST_TRUST)
        if trust > 0:
            native.reconcile(picture, features[0], features[6:9], trust, ALIKE)
        native.reconcile_shadow(picture[3], features[0], features[-1], SHADOW_TRUST, SHADOW_ALIKE)


class Lighting:
    """Light on the points (N, 3) of a cloud of that spacing, whose normals (N, 3) face the viewer, and on its floor.

    The floor lies at that height. A second core looks around from the points, from the beginning; `follow` helps it and
    goes on.
    """

    def __init__(
        self, points: np.ndarray, normals: np.ndarray, spacing: float, scene: SceneDescription, height: float
    ) -> None:
        self.points, self.normals, self.spacing, self.light_at = points, normals, spacing, scene.light
        self.color = np.array(base_color(scene), dtype=np.float32)
        self.radius = radius = math.sqrt(products(points, points).max()) + spacing
        square = light_square(scene.light)
        lamps = light_lamps(scene.light, LAMPS)
        quarters = square[0] + QUARTERS @ square[1:]
        self.floor = native.Floor(
            height, FLOOR_HALF, quarters, lamps[1][0], LIGHT_RADIANCE * LIGHT_SIDE**2, AMBIENT, FLOOR_ALBEDO
        )
        axes = sky_axes(SKY_DIRECTIONS)
        self.seen = seen = np.empty((2 * len(axes), len(points)), np.int32)

        def look_around(begin: int, end: int) -> None:
            """What the points see of each other along some axes and against them.

            It holds no `self`, which holds it: in a ring, a picture's arrays would stay until Python looks for such.
            """
            seen[2 * begin : 2 * end] = native.first_hits(points, normals, axes[begin:end], spacing, radius)

        self.look_around = rows_beside(look_around, len(axes), parts=8)

    def shade(self, found: Tangents, radii: np.ndarray, sets: int) -> None:
        """Casts the shadows of discs with those radii (M,) on the points and the floor.

        So many `sets` (1, 2 or 4) of lamps stand for the light over the floor.
        """
        lamps = light_lamps(self.light_at, LAMPS)
        casters = casters_of(self.points, self.spacing, found, radii)
        lit = native.illuminate(self.points, self.normals, casters, *lamps, self.spacing, self.radius)
        self.direct = lit / math.pi
        self.shades = floor_shades(self.points, self.spacing, casters, self.light_at, self.floor.height, sets)

    def follow(self) -> None:
        """Follows the light from the sky and the lit floor to the points, and on from there."""
        cloud = (self.points, self.normals, sky_axes(SKY_DIRECTIONS))
        self.look_around()
        below = beside(native.floor_hits, *cloud[:2], floor_sky(2 * BELOW)[::2], self.floor, GLOW_CELLS)
        self.bounces = [native.gather_open(*cloud, self.seen, self.direct, self.floor, *self.shades)]
        self.below = below.result()
        self.glows = []
        for _ in range(BOUNCES):
            light = self.bounces[-1]
            self.glows.append(native.floor_glow(light, self.below, GLOW_CELLS))
            self.bounces.append(native.gather_bounced(*cloud, self.seen, light, self.floor, self.glows[-1]))

    def draw_shadow(self, camera: Camera, out: np.ndarray) -> None:
        """Draws into `out` (H, W) the alpha of the floor's shadow."""
        height, side = self.floor.height, len(self.shades[0]) // 2
        eyes = mirrored_eyes(camera.position, height)
        narrowed = narrowed_share(self.spacing, side)
        mirrored = native.floor_shade(self.points, eyes, height, FLOOR_HALF, side, narrowed)
        native.floor_shadow(*self.shades, mirrored, self.radiance(), self.floor, camera, out)

    def radiance(self) -> np.ndarray:
        """Mean radiance (G, G) of the cloud as the floor's cells see it, over the three colours as well."""
        first, second = self.glows
        glow = self.color.mean() * first + SECOND * (self.color**2).mean() * second
        white = np.ones((2, len(self.normals)), np.float32)
        covered = native.floor_glow(white, self.below, GLOW_CELLS)
        mean: np.ndarray = around(glow) / np.maximum(around(covered), 1e-6)
        return mean

    def colors(self, viewer: np.ndarray) -> np.ndarray:
        """Radiance (N, 4) that the points send to the viewer (3,), sRGB: grey, then in the surface's colour."""
        albedo = np.array([GREY, *self.color], dtype=np.float32)
        return srgb_from_linear(np.clip(albedo * self.light(albedo), 0, 1))

    def further(self) -> list[np.ndarray]:
        """Five more numbers (N, 5) of each point, if `finish` needs what discs show of them in a pixel."""
        return []

    def finish(self, camera: Camera, rows: tuple[int, int], pictures: list[np.ndarray]) -> None:
        """Finishes rows, from the first up to the last, that one excluded, of the first picture (9, H, W).

        For numbers of `further` there is a second one, with the normal towards the camera and them for features.
        """

    def light(self, albedo: np.ndarray) -> np.ndarray:
        """What diffuse surfaces of these albedos (A,) get: (N, A), as the radiance of a white one, linear."""
        return self.gathered([bounce[0] for bounce in self.bounces], albedo)

    def gathered(self, bounces: list[np.ndarray], albedo: np.ndarray) -> np.ndarray:
        """Light (M, A) on surfaces of these albedos (A,), which get so much of each bounce, (M,) each.

        The last has all later ones in it, each as much fainter than the one before as the last was.
        """
        before, last = (float(bounce[0].mean()) for bounce in self.bounces[-2:])
        shares = albedo ** np.arange(BOUNCES + 1, dtype=np.float32)[:, None]
        shares[-1] /= 1 - min(last / max(before, 1e-6), MOST_KEPT) * albedo
        return np.einsum("bm,ba->ma", np.stack(bounces), shares)


Surfels.lighting = Lighting


def lamp_sets_for(camera: Camera) -> int:
    """How many times lamps stand over the floor for a picture of that size."""
    side = max(camera.width, camera.height)
    return 1 if side <= SMALL else 2 if side <= MIDDLING else 4


def mirrored_eyes(viewer: np.ndarray, floor: float) -> np.ndarray:
    """Places (64, 3) below a rough floor of that height, from which a viewer (3,) would see what he sees mirrored.

    The lobe that the floor reflects to him is taken to have the same shape all over, that at its middle.
    """
    towards = viewer - (0.0, 0.0, floor)
    distance = float(np.linalg.norm(towards))
    aside = np.array([towards[0], towards[1], 0.0]) / max(math.hypot(towards[0], towards[1]), 1e-9)
    axes = np.stack([aside, np.cross((0.0, 0.0, 1.0), aside), (0.0, 0.0, 1.0)])
    ways = mirror_directions(round(float(towards[2]) / distance, 4), FLOOR_ROUGHNESS, FLOOR_INDEX, MIRRORED)
    places: np.ndarray = np.array([0.0, 0.0, floor]) - distance * ways @ axes
    return places


def around(cells: np.ndarray) -> np.ndarray:
    """Sums over three by three cells; those beyond the border count as none."""
    padded = np.pad(cells, 1)
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    total: np.ndarray = rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
    return total


def with_holes(colors: np.ndarray, neighbours: np.ndarray) -> np.ndarray:
    """Colours (M, C) of discs with these neighbours (M, K): those of the points (N, C), and in holes of the rim."""
    rim = neighbours[len(colors) :, :HOLE_RIM]
    return np.concatenate([colors, colors[rim].mean(axis=1)])


def faced(points: np.ndarray, normals: np.ndarray, viewer: np.ndarray) -> np.ndarray:
    """Normals (N, 3) of points (N, 3), each turned towards the viewer (3,); of one or two points, its direction."""
    if len(points) < 3:
        towards = viewer.astype(np.float32) - points
        return towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-6)
    away = products(points - viewer.astype(np.float32), normals) > 0
    return normals * np.where(away, np.float32(-1), np.float32(1))[:, None]


def base_color(scene: SceneDescription) -> tuple[float, float, float]:
    """Linear colour of the surface; Blender's own grey where no control sets one."""
    color = scene.material.get("Base Color", (0.8, 0.8, 0.8, 1.0))
    return (color[0], color[1], color[2]) if isinstance(color, tuple) else (color, color, color)
