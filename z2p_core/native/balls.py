"""Bindings of `c/balls/`: light on balls, and images of them.

N balls in the order of their tree, K directions. Arrays are float32 unless said otherwise. Everything is in world
units. The light of a ball (`LIGHT_VALUES`,) is the radiance of its white surface: of indirect light in three colors the
mean, then the gradient along the normal's x, y and z; of direct light a table over the octahedral map of normals.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from z2p_core.native.library import BYTES_OUT, FLOAT, FLOATS, FLOATS_OUT, INT, INTS, INTS_OUT, Struct, call, declare
from z2p_core.parallel import parallel_map, parallel_rows

BLOCK = 8
"""Spheres in a block, and the other constants of `c/balls/ball_tree.h`."""
MAX_LEVELS = 12
INDIRECT_VALUES = 12
LIGHT_VALUES = INDIRECT_VALUES + 36
"""Numbers of a ball's light, as in `c/balls/ball_light.h`."""
MAX_DIRECTIONS = 128
"""Most directions in which a ball looks around, as in `c/balls/ball_draw.c`."""
MAX_SIDE_SAMPLES = 4
"""Most samples of a pixel along a side, as there."""
FAR_AWAY = 1e4
"""Coordinate of spheres that only fill a block up."""
STRIP_ROWS = 16
"""Rows of an image that are drawn at a time: their samples fit into a core's cache."""


class BallLevels(ctypes.Structure):
    """The C structure of that name (`c/balls/ball_tree.h`)."""

    _fields_ = [("levels", ctypes.c_int), ("starts", ctypes.c_int * MAX_LEVELS)]


class BallScene(ctypes.Structure):
    """The C structure of that name (`c/balls/ball_light.h`)."""

    _fields_ = [
        ("light", ctypes.c_float * 3 * 3),
        ("light_axis", ctypes.c_float * 3),
        ("light_power", ctypes.c_float),
        ("sky_radiance", ctypes.c_float),
        ("floor_height", ctypes.c_float),
        ("floor_half_size", ctypes.c_float),
        ("floor_side", ctypes.c_int),
    ]


class BallView(ctypes.Structure):
    """The C structure of that name (`c/balls/ball_draw.c`)."""

    _fields_ = [
        ("rotation", ctypes.c_float * 3 * 3),
        ("position", ctypes.c_float * 3),
        ("focal", ctypes.c_float * 2),
        ("center", ctypes.c_float * 2),
        ("orthographic", ctypes.c_int),
        ("width", ctypes.c_int),
        ("height", ctypes.c_int),
        ("first_row", ctypes.c_int),
        ("last_row", ctypes.c_int),
        ("side_samples", ctypes.c_int),
        ("filter", ctypes.c_float * MAX_SIDE_SAMPLES),
        ("near_depth", ctypes.c_float),
        ("relight", ctypes.c_float),
        ("floor_albedo", ctypes.c_float),
        ("draws_floor", ctypes.c_int),
    ]


LEVELS, SCENE, VIEW = Struct(BallLevels), Struct(BallScene), Struct(BallView)
declare(
    "z2p_trace_from_balls", tree=FLOATS, levels=LEVELS, balls=INTS, begin=INT, end=INT, min_distances=FLOATS,
    directions=FLOATS, direction_count=INT, hits=INTS_OUT, distances=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_ball_direct_light", tree=FLOATS, levels=LEVELS, scene=SCENE, balls=INTS, begin=INT, end=INT,
    light=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_radiance_around_balls", tree=FLOATS, scene=SCENE, balls=INTS, begin=INT, end=INT, directions=FLOATS,
    direction_count=INT, hits=INTS, distances=FLOATS, light=FLOATS, group_bits=INT, albedo=FLOATS, floor=FLOATS,
    outside=FLOATS, radiance=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_nearest_balls", tree=FLOATS, levels=LEVELS, balls=INTS, begin=INT, end=INT, reach=FLOAT, room=INT,
    nearest=INTS_OUT, limits=FLOATS_OUT,
)  # fmt: skip
declare(
    "z2p_balls_over_floor", balls=FLOATS, count=INT, scene=SCENE, samples=FLOATS, weights=FLOATS, begin=INT, end=INT,
    light_indices=INTS, albedo_indices=INTS, light=FLOATS, albedo=FLOATS, hidden=FLOATS_OUT, sent=FLOATS_OUT,
)  # fmt: skip
declare("z2p_mark_visible_balls", balls=FLOATS, count=INT, view=VIEW, visible=BYTES_OUT)
declare(
    "z2p_draw_balls", tree=FLOATS, levels=LEVELS, scene=SCENE, view=VIEW, balls=FLOATS, count=INT, visible_index=INTS,
    nearest=INTS, room=INT, far_index=INTS, directions=FLOATS, direction_count=INT, far_radiance=FLOATS, light=FLOATS,
    group_bits=INT, albedo=FLOATS, hidden=FLOATS, sent=FLOATS, image=FLOATS_OUT,
)  # fmt: skip


@dataclass(frozen=True)
class BallTree:
    """Balls in an order in which neighbors lie together, and a tree of spheres that bound them."""

    balls: np.ndarray
    """(N, 4): center and radius of each, in the tree's order."""
    order: np.ndarray
    """(N,) indices of the balls in the caller's order."""
    spheres: np.ndarray
    """(blocks, 4, 8): blocks of all levels."""
    levels: BallLevels

    @classmethod
    def build(cls, centers: np.ndarray, radii: np.ndarray) -> BallTree:
        """The tree of balls with centers (N, 3) and radii (N,), N at least 1; the same for every order of the balls."""
        order = morton_order(centers)
        balls = np.column_stack([centers, radii]).astype(np.float32)[order]
        blocks, starts, spheres = [], [0], balls
        while True:
            block, bounds = _bound(spheres)
            blocks.append(block)
            if len(block) == 1:
                break
            starts.append(starts[-1] + len(block))
            spheres = bounds
        levels = BallLevels(levels=len(blocks))
        np.ctypeslib.as_array(levels.starts)[: len(starts)] = starts
        return cls(balls, order, np.ascontiguousarray(np.concatenate(blocks)), levels)

    def __len__(self) -> int:
        return len(self.balls)

    @cached_property
    def everything(self) -> np.ndarray:
        """Indices (N,) int32 of all balls."""
        return np.arange(len(self), dtype=np.int32)


def morton_order(points: np.ndarray) -> np.ndarray:
    """Order (N,) of points (N, 3) along a Z curve, which does not depend on the order in which they are given."""
    low = points.min(axis=0).astype(np.float64)
    extent = max(float((points.max(axis=0) - low).max()), 1e-12)
    cells = ((points - low) * ((2**21 - 1) / extent)).astype(np.uint64)
    for shift, mask in ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
                        (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249)):  # fmt: skip
        cells = (cells | cells << np.uint64(shift)) & np.uint64(mask)
    keys = cells[:, 0] | cells[:, 1] << np.uint64(1) | cells[:, 2] << np.uint64(2)
    return np.argsort(keys, kind="stable")


def _bound(spheres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Blocks (B, 4, 8) of spheres (S, 4), and the spheres (B, 4) that bound them."""
    count = -(-len(spheres) // BLOCK)
    missing = count * BLOCK - len(spheres)
    blocks = np.concatenate([spheres, np.repeat(spheres[-1:], missing, axis=0)]).reshape(count, BLOCK, 4)
    centers, radii = blocks[..., :3], blocks[..., 3]
    low = (centers - radii[..., None]).min(axis=1)
    middle = 0.5 * (low + (centers + radii[..., None]).max(axis=1))
    reach = (np.linalg.norm(centers - middle[:, None], axis=2) + radii).max(axis=1) * np.float32(1 + 1e-5)
    if missing:
        blocks[-1, BLOCK - missing :] = (FAR_AWAY, FAR_AWAY, FAR_AWAY, 0)
    return blocks.transpose(0, 2, 1), np.column_stack([middle, reach]).astype(np.float32)


def trace_from_balls(
    tree: BallTree, balls: np.ndarray, directions: np.ndarray, min_distances: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The balls (B, K) int32 that rays from the centers of some balls hit first, -1 for none; and the distances (B, K).

    Args:
        tree: the balls.
        balls: (B,) int32, from whose centers rays start; they do not see themselves.
        directions: (K, 3), unit length.
        min_distances: (B,), balls whose surfaces are nearer to the center are not seen; None for 0.
    """
    hits = np.empty((len(balls), len(directions)), np.int32)
    distances = np.empty(hits.shape, np.float32)
    limits = np.zeros(len(balls), np.float32) if min_distances is None else min_distances

    def trace(begin: int, end: int) -> None:
        call("z2p_trace_from_balls", tree.spheres, tree.levels, balls, begin, end, limits, directions,
             len(directions), hits, distances)  # fmt: skip

    parallel_rows(trace, len(balls))
    return hits, distances


def ball_direct_light(tree: BallTree, scene: BallScene, balls: np.ndarray) -> np.ndarray:
    """Light (B, `LIGHT_VALUES`) of some balls (B,) int32 from the area light alone."""
    light = np.zeros((len(balls), LIGHT_VALUES), np.float32)

    def shine(begin: int, end: int) -> None:
        call("z2p_ball_direct_light", tree.spheres, tree.levels, scene, balls, begin, end, light)

    parallel_rows(shine, len(balls))
    return light


@dataclass(frozen=True)
class Senders:
    """What sends light besides the area light."""

    light: np.ndarray
    """(G, `LIGHT_VALUES`): the light of groups of balls; ball b is in group b >> `group_bits`."""
    group_bits: int
    albedo: np.ndarray
    """(N, 3), linear."""
    floor: np.ndarray
    """(S, S, 3): the radiance of the floor's cells."""
    outside: np.ndarray
    """(3,): that of the floor beyond them."""


def radiance_around_balls(
    tree: BallTree, scene: BallScene, balls: np.ndarray, directions: np.ndarray, seen: tuple[np.ndarray, np.ndarray],
    senders: Senders,
) -> np.ndarray:  # fmt: skip
    """Radiance (B, K, 3) that comes to the centers of some balls along directions; `seen` as of `trace_from_balls`."""
    radiance = np.empty((len(balls), len(directions), 3), np.float32)

    def look(begin: int, end: int) -> None:
        call("z2p_radiance_around_balls", tree.spheres, scene, balls, begin, end, directions, len(directions), *seen,
             senders.light, senders.group_bits, senders.albedo, senders.floor, senders.outside, radiance)  # fmt: skip

    parallel_rows(look, len(balls))
    return radiance


def nearest_balls(tree: BallTree, balls: np.ndarray, reach: float, room: int) -> tuple[np.ndarray, np.ndarray]:
    """The balls (B, room) int32 nearest to some balls (B,) int32, nearest first, then -1; and how far these reach (B,).

    They are those whose surfaces lie within `reach` radii of the ball's center, at most `room`.
    """
    nearest, limits = np.empty((len(balls), room), np.int32), np.empty(len(balls), np.float32)

    def search(begin: int, end: int) -> None:
        call("z2p_nearest_balls", tree.spheres, tree.levels, balls, begin, end, reach, room, nearest, limits)

    parallel_rows(search, len(balls))
    return nearest, limits


def balls_over_floor(
    balls: np.ndarray, indices: np.ndarray, scene: BallScene, samples: np.ndarray, weights: np.ndarray,
    senders: Senders,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Share (S, S) of weighted samples that balls hide from the floor's cells; and the light (S, S, 3) they send there.

    Args:
        balls: (B, 4), centers and radii.
        indices: (B,) int32, which ball of the tree each stands for.
        samples: (L, 3), positions; those below the floor are viewers mirrored in it.
        weights: (L,).
    """
    side = scene.floor_side
    light_indices = np.ascontiguousarray(indices >> senders.group_bits)
    parts = [(0, len(samples) // 2), (len(samples) // 2, len(samples))]  # always two, so that sums stay the same

    def draw(begin: int, end: int) -> tuple[np.ndarray, np.ndarray]:
        hidden, sent = np.zeros((side, side), np.float32), np.zeros((side, side, 3), np.float32)
        call("z2p_balls_over_floor", balls, len(balls), scene, samples, weights, begin, end, light_indices, indices,
             senders.light, senders.albedo, hidden, sent)  # fmt: skip
        return hidden, sent

    first, second = parallel_map([partial(draw, *part) for part in parts])
    return first[0] + second[0], first[1] + second[1]


def visible_balls(balls_in_camera: np.ndarray, view: BallView) -> np.ndarray:
    """Indices (V,) int32 of the balls (N, 4), in camera coordinates, that an image shows."""
    visible = np.zeros(len(balls_in_camera), np.uint8)
    _draw_strips("z2p_mark_visible_balls", view, lambda part: (balls_in_camera, len(balls_in_camera), part, visible))
    return np.flatnonzero(visible).astype(np.int32)


def _draw_strips(kernel: str, view: BallView, arguments: object) -> None:
    """Calls a kernel for strips of a view in turn, on both cores."""
    strips = -(-view.height // STRIP_ROWS)

    def draw(begin: int, end: int) -> None:
        for strip in range(begin, end):
            part = BallView.from_buffer_copy(view)
            part.first_row, part.last_row = strip * STRIP_ROWS, min((strip + 1) * STRIP_ROWS, view.height)
            call(kernel, *arguments(part))  # type: ignore[operator]

    parallel_rows(draw, strips, smallest=2, parts=strips)


def draw_balls(
    tree: BallTree, scene: BallScene, view: BallView, balls_in_camera: np.ndarray, visible_index: np.ndarray,
    nearest: np.ndarray, far_index: np.ndarray, directions: np.ndarray, far_radiance: np.ndarray, senders: Senders,
    hidden: np.ndarray, sent: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Image (4, H, W), premultiplied linear color and alpha, of balls and the shadow on the floor.

    Args:
        balls_in_camera: (N, 4), centers in camera axes relative to the camera, and radii.
        visible_index: (N,) int32, each ball's row in the following arrays, -1 for those that cannot be seen.
        nearest: (V, R) int32, from `nearest_balls`.
        far_index: (V,) int32, each ball's row in `far_radiance`.
        directions: (K, 3), K <= `MAX_DIRECTIONS`.
        far_radiance: (F, K, 3), what comes from beyond the nearest balls.
        senders: what the nearest balls send.
        hidden: (2, S, S), shares of the sky and of the mirrored sky that balls hide from the floor.
        sent: (2, S, S), the light that they send there instead.
    """
    image = np.empty((4, view.height, view.width), np.float32)
    columns = np.ascontiguousarray(directions.T)
    _draw_strips("z2p_draw_balls", view, lambda part: (
        tree.spheres, tree.levels, scene, part, balls_in_camera, len(balls_in_camera), visible_index, nearest,
        nearest.shape[1], far_index, columns, len(directions), far_radiance, senders.light, senders.group_bits,
        senders.albedo, hidden, sent, image,
    ))  # fmt: skip
    return image
