"""Pictures of balls: each point of a cloud is a lit diffuse ball, above a floor that only shows its shadow.

Light is that of the scene that ground truth is path traced in: a square area light, a uniform sky, the floor that both
light, and what balls send to each other. Nothing is random. Each visible ball is shaded where a pixel shows it:

- the area light past all other balls, by 8 x 8 samples of it;
- what comes from around: nearby balls are intersected from the place itself, in `DIRECTIONS` directions; what lies
  farther is found once for each ball, from its center;
- what balls send on is a table of direct light and a linear function of the normal for all other light, found by
  `BOUNCES` rounds of gathering.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from z2p_core.camera import Camera
from z2p_core.linalg import rotate_points
from z2p_core.native import balls as kernels
from z2p_core.native.balls import BallScene, BallTree, BallView, Senders
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription
from z2p_core.shading.area_light import area_light_quad, area_light_samples, cosine_hemisphere
from z2p_core.shading.floor_occlusion import FLOOR_HALF_WIDTH, SKY_DISTANCE
from z2p_core.shading.floor_shadow import mirrored_viewpoints
from z2p_core.shading.light_transport import FLOOR_ALBEDO

DIRECTIONS = 64
"""Directions in which a ball looks around, over the whole sphere."""
NEAR_REACH = 4.0
"""Balls whose surfaces lie within so many radii of a ball's center are intersected exactly where it is shaded."""
NEAR_ROOM = 32
"""Most of them."""
BOUNCES = 3
"""How often light is gathered from ball to ball."""
FLOOR_CELLS = 288
"""Cells along a side of the floor's grid."""
FLOOR_SKY_SAMPLES, FLOOR_LIGHT_SAMPLES, MIRROR_SAMPLES = 128, 64, 64
"""Samples of the sky, of the area light and of the floor's mirror image for the floor's grid."""
MAX_GROUPS = 1 << 14
"""Most groups of neighboring balls whose light is computed; of more balls, groups of 2, 4, 8 ... share theirs."""
MAX_FLOOR_BALLS = 1 << 14
"""Balls that shade the floor's grid, at most: of more, every 2nd, 4th ... with a wider radius stands for its group."""
MAX_FAR_ROWS = 1 << 16
"""Most visible balls, or groups of them, that look around."""
FOUR_SAMPLES_MAX_SIDE = 1100
"""Longer side of an image, in pixels, up to which pixels have 4 x 4 samples; beyond, 3 x 3."""
FILTER_WIDTH = 1.5
"""Width of Cycles' Blackman-Harris pixel filter, in pixels."""
NEAR_DEPTH = 0.05
"""Depth up to which nothing is drawn, in world units."""


@dataclass(frozen=True)
class Balls:
    """Balls in world units."""

    centers: np.ndarray
    """(N, 3) float32."""
    radii: np.ndarray
    """(N,) float32, positive."""
    albedo: np.ndarray
    """(N, 3) float32, linear."""
    relight: float = 1.0
    """How much of the studio's light falls on the colors: 1 all of it, 0 shows them as they are."""


def draw_balls(balls: Balls, camera: Camera, scene: SceneDescription) -> np.ndarray:
    """Image (4, H, W) float32 of balls, premultiplied linear color and alpha, the floor's shadow included.

    Without `scene.floor` the floor touches the lowest ball.
    """
    tree = BallTree.build(balls.centers, balls.radii)
    albedo = np.ascontiguousarray(balls.albedo[tree.order], np.float32)
    lowest = float((balls.centers[:, 2] - balls.radii).min())
    floor_height = lowest if scene.floor is None else scene.floor
    ball_scene = make_scene(scene, floor_height)
    view = make_view(camera, floor_height, balls.relight)
    rotation, position = camera.rotation.astype(np.float32), camera.position.astype(np.float32)
    in_camera = np.column_stack([rotate_points(tree.balls[:, :3] - position, rotation), tree.balls[:, 3]])
    light = Lighting(tree, albedo, ball_scene)
    senders = light.settle()
    visible = kernels.visible_balls(in_camera, view)
    nearest, far_index, far_radiance = light.surroundings(visible, senders)
    visible_index = np.full(len(tree), -1, np.int32)
    visible_index[visible] = np.arange(len(visible), dtype=np.int32)
    hidden, sent = light.floor_grids(senders, camera)
    return kernels.draw_balls(
        tree, ball_scene, view, in_camera, visible_index, nearest, far_index, light.directions, far_radiance, senders,
        hidden, sent,
    )  # fmt: skip


class Lighting:
    """Light on balls in a scene."""

    def __init__(self, tree: BallTree, albedo: np.ndarray, scene: BallScene) -> None:
        """`albedo` (N, 3) is in the tree's order."""
        self.tree, self.albedo, self.scene = tree, albedo, scene
        self.directions = sphere_directions(DIRECTIONS)
        self.group_bits = _bits_for(len(tree), MAX_GROUPS)
        self.outside = np.zeros(3, np.float32)
        bits = _bits_for(len(tree), MAX_FLOOR_BALLS)
        stride = 1 << bits
        self.floor_balls, self.floor_indices = tree.balls[::stride].copy(), tree.everything[::stride].copy()
        self.floor_balls[:, 3] *= math.sqrt(stride)

    def settle(self) -> Senders:
        """The light that balls and floor send after some bounces."""
        step = 1 << self.group_bits
        groups = np.minimum(self.tree.everything[::step] + step // 2, len(self.tree) - 1).astype(np.int32)
        direct = kernels.ball_direct_light(self.tree, self.scene, groups)
        seen = kernels.trace_from_balls(self.tree, groups, self.directions)
        unlit, dark = np.zeros_like(direct), np.zeros((FLOOR_CELLS, FLOOR_CELLS, 3), np.float32)
        nothing = Senders(unlit, self.group_bits, self.albedo, dark, self.outside)
        light_lost, _ = self._over_floor(area_light_from(self.scene), nothing)
        sky_lost, _ = self._over_floor(cosine_sky(), nothing)
        unhidden = unhidden_floor_light(self.scene)
        floor = FLOOR_ALBEDO * (unhidden * (1 - light_lost) + AMBIENT * (1 - sky_lost))
        outside = np.full(3, FLOOR_ALBEDO * AMBIENT, np.float32)
        senders = Senders(direct, self.group_bits, self.albedo, _grey(floor), outside)
        for bounce in range(BOUNCES):
            radiance = kernels.radiance_around_balls(self.tree, self.scene, groups, self.directions, seen, senders)
            light = direct.copy()
            light[:, : kernels.INDIRECT_VALUES] = project_radiance(radiance, self.directions)
            received = senders.floor
            if bounce == BOUNCES - 2:
                lit = Senders(light, self.group_bits, self.albedo, dark, outside)
                _, sent = self._over_floor(cosine_sky(), lit)
                received = _grey(floor) + FLOOR_ALBEDO * sent
            senders = Senders(light, self.group_bits, self.albedo, received, outside)
        return senders

    def surroundings(self, visible: np.ndarray, senders: Senders) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For visible balls (V,): the nearest ones (V, R), rows (V,) of the radiance from afar, and this (F, K, 3)."""
        if not len(visible):
            return np.empty((1, 1), np.int32), np.zeros(1, np.int32), np.zeros((1, DIRECTIONS, 3), np.float32)
        nearest, limits = kernels.nearest_balls(self.tree, visible, NEAR_REACH, NEAR_ROOM)
        bits = 0
        while len(np.unique(visible >> bits)) > MAX_FAR_ROWS:
            bits += 1
        _, first, rows = np.unique(visible >> bits, return_index=True, return_inverse=True)
        lookouts, limits = visible[first], limits[first]
        seen = kernels.trace_from_balls(self.tree, lookouts, self.directions, limits)
        radiance = kernels.radiance_around_balls(self.tree, self.scene, lookouts, self.directions, seen, senders)
        return nearest, rows.astype(np.int32), radiance

    def floor_grids(self, senders: Senders, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """Grids (2, S, S) for the floor's image: shares of sky and mirrored sky that are hidden, and light sent."""
        sky, sent = self._over_floor(cosine_sky(), senders)
        if camera.position[2] <= self.scene.floor_height:
            return np.stack([sky, sky]), np.stack([sent.mean(axis=2)] * 2)
        viewpoints = mirrored_viewpoints(camera.position, self.scene.floor_height, MIRROR_SAMPLES)
        weights = np.full(len(viewpoints), 1 / len(viewpoints), np.float32)
        mirrored, reflected = self._over_floor((viewpoints.astype(np.float32), weights), senders)
        return np.stack([sky, mirrored]), np.stack([sent.mean(axis=2), reflected.mean(axis=2)])

    def _over_floor(self, samples: tuple[np.ndarray, np.ndarray], senders: Senders) -> tuple[np.ndarray, np.ndarray]:
        return kernels.balls_over_floor(self.floor_balls, self.floor_indices, self.scene, *samples, senders)


def make_scene(scene: SceneDescription, floor_height: float) -> BallScene:
    """The lights and the floor of a scene."""
    quad, axis = area_light_quad(scene.light), area_light_samples(scene.light, 1)[1][0]
    made = BallScene(
        light_power=LIGHT_RADIANCE * LIGHT_SIDE**2, sky_radiance=AMBIENT, floor_height=floor_height,
        floor_half_size=FLOOR_HALF_WIDTH, floor_side=FLOOR_CELLS,
    )  # fmt: skip
    np.ctypeslib.as_array(made.light)[:] = quad
    np.ctypeslib.as_array(made.light_axis)[:] = axis
    return made


def make_view(camera: Camera, floor_height: float, relight: float) -> BallView:
    """The camera's view with the samples of its pixels."""
    side_samples = 4 if max(camera.width, camera.height) <= FOUR_SAMPLES_MAX_SIDE else 3
    view = BallView(
        orthographic=int(camera.orthographic), width=camera.width, height=camera.height, side_samples=side_samples,
        near_depth=NEAR_DEPTH, relight=relight,
        floor_albedo=FLOOR_ALBEDO, draws_floor=int(camera.position[2] > floor_height),
    )  # fmt: skip
    np.ctypeslib.as_array(view.rotation)[:] = camera.rotation
    np.ctypeslib.as_array(view.position)[:] = camera.position
    np.ctypeslib.as_array(view.focal)[:] = camera.focal_lengths
    np.ctypeslib.as_array(view.center)[:] = camera.principal_point
    np.ctypeslib.as_array(view.filter)[:side_samples] = pixel_filter(side_samples)
    return view


def pixel_filter(samples: int) -> np.ndarray:
    """Weights (samples,) of a pixel's samples along a side, which sum to 1: Cycles' filter within the pixel."""
    angle = 2 * math.pi / FILTER_WIDTH * ((np.arange(samples) + 0.5) / samples - 0.5)
    weights = 0.35875 + 0.48829 * np.cos(angle) + 0.14128 * np.cos(2 * angle) + 0.01168 * np.cos(3 * angle)
    shares: np.ndarray = weights / weights.sum()
    return shares


def sphere_directions(count: int) -> np.ndarray:
    """Unit vectors (count, 3) float32, evenly distributed over the sphere (a Fibonacci spiral)."""
    height = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - height**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height]).astype(np.float32)


def project_radiance(radiance: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Light (B, 12) that radiance (B, K, 3) from K even directions (K, 3) gives balls.

    The linear part of the cosine lobe: irradiance / pi at a normal n is mean(L) + 2 n . mean(L d).
    """
    mean = radiance.mean(axis=1)
    gradient = 2 / len(directions) * np.einsum("bkc,ka->bac", radiance, directions)
    return np.concatenate([mean, gradient.reshape(len(radiance), 9)], axis=1).astype(np.float32)


def cosine_sky() -> tuple[np.ndarray, np.ndarray]:
    """Positions (L, 3) and weights (L,) of samples of the sky, whose weights sum to 1."""
    positions = (SKY_DISTANCE * cosine_hemisphere(FLOOR_SKY_SAMPLES)).astype(np.float32)
    return positions, np.full(len(positions), 1 / len(positions), np.float32)


def area_light_from(scene: BallScene) -> tuple[np.ndarray, np.ndarray]:
    """Positions (L, 3) and equal weights (L,) of samples of the area light, whose weights sum to 1."""
    center, across, up = np.ctypeslib.as_array(scene.light)
    count = math.isqrt(FLOOR_LIGHT_SAMPLES)
    steps = (np.arange(count) + 0.5) / count - 0.5
    x, y = (grid.reshape(-1, 1) for grid in np.meshgrid(steps, steps))
    positions = (center + x * across + y * up).astype(np.float32)
    return positions, np.full(len(positions), 1 / len(positions), np.float32)


def unhidden_floor_light(scene: BallScene) -> np.ndarray:
    """Radiance (S, S) of a white floor's cells under the area light alone, without shadows."""
    light, axis = np.ctypeslib.as_array(scene.light), np.ctypeslib.as_array(scene.light_axis)
    half, side = scene.floor_half_size, scene.floor_side
    cells = ((np.arange(side) + 0.5) * (2 * half / side) - half).astype(np.float32)
    total = np.zeros((side, side), np.float32)
    for s in (-0.25, 0.25):
        for t in (-0.25, 0.25):
            x, y, z = light[0] + s * light[1] + t * light[2]
            dx, dy, dz = x - cells[None, :], y - cells[:, None], np.float32(z - scene.floor_height)
            distance_sq = dx**2 + dy**2 + dz**2
            along_axis = -(dx * axis[0] + dy * axis[1] + dz * axis[2])
            total += np.maximum(along_axis, 0) * dz / distance_sq**2
    lit: np.ndarray = total * np.float32(scene.light_power / 4 / math.pi)
    return lit


def _grey(grid: np.ndarray) -> np.ndarray:
    """A grid (S, S) in three equal colors (S, S, 3)."""
    return np.repeat(grid[:, :, None], 3, axis=2).astype(np.float32)


def _bits_for(count: int, most: int) -> int:
    """The smallest b for which count >> b is at most `most`."""
    bits = 0
    while count >> bits > most:
        bits += 1
    return bits


