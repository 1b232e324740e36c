"""What casts the shadows of a cloud, and how much of the lamp's and the sky's light it hides from the floor below it.

The floor's shade is counted in cells, in which the shadows of points close up (`native/shade.c`). A cell that a shadow
only touches is in it, and points fall short of outlines; how wide the cells are, and how many lamps' shadows are made
narrower, leaves neither too much shade nor too little on the whole, as rays through the meshes of clouds of 1,000 to
40,000 points tell.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from z2p_core import native
from z2p_core.parallel import parallel_map
from z2p_core.shading.area_light import cosine_hemisphere, jittered_sample_sets, area_light_quad
from z2p_core.shading.surfels import SAMPLES_PER_DISC, disc_sample_points
from z2p_core.surface.normals import Tangents

Shading = list[Callable[[], np.ndarray]]
"""What work out shades each, on whichever core is idle."""

FLOOR_HALF_WIDTH, MIN_FLOOR_CELL, MAX_FLOOR_CELLS = 4.5, 0.0125, 720
"""Extent of the floor that shadows are kept for, its finest cell in world units, and its most cells a side."""
POINT_CELLS_PER_SPACING = 1.5
"""Spacing of points in the cells that their shadows close up in."""
SPARSE_MIN_CELLS, DISC_CELLS_PER_SPACING, DISC_BALL_SPACINGS = 2.0, 2.4, 0.2
"""Spacing in finest cells from which on points are spread out to their discs, the cells that a spacing then has, and
the radius of the balls that these are. Denser ones gain little by it and would cost much."""
POINT_MAP_CELLS_PER_SPACING, DISC_MAP_CELLS_PER_SPACING = 1.5, 3.0
"""Cells for each spacing of the maps that tell which points lie in others' shadows, of points and of discs."""
UNERODED_SHARE_PER_CELL = 0.4
"""Share of the lamps that points fall short of outlines for, for each cell that they lie apart."""
POINT_BALL_SPACINGS = 0.7
"""Radius in spacings of the balls that points are where a lamp draws their shadow out."""
FLOOR_LIGHT_SAMPLES, FLOOR_SKY_DIRECTIONS, MAX_SKY_POINTS = 64, 128, 10_000
"""Lamps that stand for the light, a square number; directions that stand for the sky, and the points of a larger cloud
that are enough for them, since its shade is soft."""
LIGHT_BLUR_CELLS, SKY_BLUR_CELLS = 2, 3
"""Cells to every side over which steps are averaged that so few lamps leave in a penumbra, and directions in the sky's
shadow."""
SKY_DISTANCE = 50.0
"""Distance at which a lamp is a direction."""


def shadow_casters(
    points: np.ndarray, spacing: float, found: Tangents, radii: np.ndarray, apart: bool
) -> native.Casters:
    """What casts the shadows of points (N, 3) of that spacing: themselves, or, where they lie `apart`, their discs.

    These are `found`, the points' own first, with `radii` (M,).
    """
    if not apart:
        return native.Casters(points, np.arange(len(points), dtype=np.int32), spacing / POINT_MAP_CELLS_PER_SPACING)
    holes = found.neighbours[len(points) :, 0]  # whose discs belong to the nearest point
    owners = np.concatenate([np.arange(len(points), dtype=np.int32), holes])
    return native.Casters(disc_sample_points(found, radii), np.repeat(owners, SAMPLES_PER_DISC), spacing / DISC_MAP_CELLS_PER_SPACING)


def is_sparse(spacing: float) -> bool:
    """Whether points of that spacing lie so far apart that they are better spread out to their discs."""
    return spacing >= SPARSE_MIN_CELLS * MIN_FLOOR_CELL


def floor_occlusion(
    points: np.ndarray, spacing: float, casters: native.Casters, light: tuple[float, float, float], height: float,
    sets: int, apart: bool, sky_count: int = FLOOR_SKY_DIRECTIONS,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Shares (S, S) of the lamp's and of the sky's light that points (N, 3) of that spacing hide from a floor.

    The lamp's shadow is that of the casters, points or, where these lie `apart`, discs. The floor lies at that
    `height`; so many `sets` (1, 2 or 4) of lamps stand for the light, and `sky_count` directions for the sky.
    """
    if apart:
        side, narrowed, ball = _cell_count(spacing / DISC_CELLS_PER_SPACING), 1.0, DISC_BALL_SPACINGS
    else:
        side, ball = _cell_count(spacing / POINT_CELLS_PER_SPACING), POINT_BALL_SPACINGS
        narrowed = eroded_share(spacing, side)
    cast_by = partial(native.floor_shade, casters.places, floor=height, half=FLOOR_HALF_WIDTH, side=side, narrowed=narrowed,
                      ball=ball * spacing, soft=LIGHT_BLUR_CELLS, square=area_light_quad(light))  # fmt: skip
    lamps: Shading = [partial(cast_by, places) for places in jittered_sample_sets(light, FLOOR_LIGHT_SAMPLES, sets)]
    *shades, first, second = parallel_map(lamps + _sky_occlusion_halves(points, spacing, height, sky_count))
    sky = native.in_other_cells((first + second) / np.float32(2), side)
    return sum(shades[1:], shades[0]) / np.float32(sets), sky


def eroded_share(spacing: float, side: int) -> float:
    """Share of the lamps whose shadows on `side` cells a side are made narrower, for points of that spacing."""
    return max(1 - UNERODED_SHARE_PER_CELL * spacing * side / (2 * FLOOR_HALF_WIDTH), 0)


def _sky_occlusion_halves(points: np.ndarray, spacing: float, height: float, count: int) -> Shading:
    """What work out the share (Q, Q) that points (N, 3) hide of the sky's light, from half of so many directions."""
    every = -(-len(points) // MAX_SKY_POINTS)
    side = _cell_count(spacing * math.sqrt(every) / POINT_CELLS_PER_SPACING)
    ways, fewer = SKY_DISTANCE * cosine_hemisphere(count), points[::every]
    return [partial(native.floor_shade, fewer, ways[half::2], height, FLOOR_HALF_WIDTH, side, 1.0, soft=SKY_BLUR_CELLS)
            for half in (0, 1)]  # fmt: skip


def _cell_count(cell: float) -> int:
    """Cells a side, of about that width; two at least, between which a shade can be told."""
    return max(min(MAX_FLOOR_CELLS, int(2 * FLOOR_HALF_WIDTH / max(cell, MIN_FLOOR_CELL))), 2)
