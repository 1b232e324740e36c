"""What casts a cloud's shadows, and how much light it takes from the floor below it.

The floor is a square of cells. For each cell, occlusion is the share of light samples (or of sky directions) that the
cloud hides. Shadows of single points are joined to shadows of surfaces because a cell counts as shadowed where a shadow
touches it (`z2p_core/native/c/lighting/floor_occlusion.c`). This makes shadows too large by up to a cell, while points,
which lie within outlines, make them too small. The cell size, and a share of light samples whose shadows are eroded by
a cell, balance the two: they are fitted to ray-traced shadows of meshes from which clouds of 1,000 to 40,000 points
were sampled.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from z2p_core import native
from z2p_core.parallel import parallel_map
from z2p_core.shading.area_light import area_light_quad, cosine_hemisphere, jittered_sample_sets
from z2p_core.shading.surfels import SAMPLES_PER_DISC, disc_sample_points
from z2p_core.surface.normals import SurfacePoints

FLOOR_HALF_WIDTH = 4.5
"""How far the floor that receives shadows reaches from the origin, in world units."""
MIN_FLOOR_CELL = 0.0125
"""Width of the floor's smallest cells, in world units."""
MAX_FLOOR_CELLS = 720
"""Most cells along a side of the floor."""

SPARSE_MIN_CELLS = 2.0
"""Spacing of points, in the smallest cells, from which on discs cast the shadows: denser clouds gain little by it."""
POINT_CELLS_PER_SPACING = 1.5
"""Floor cells for each spacing of points that cast shadows themselves."""
DISC_CELLS_PER_SPACING = 2.4
"""Floor cells for each spacing of points whose discs cast shadows."""
POINT_MAP_CELLS_PER_SPACING = 1.5
"""Cells of the shadow maps on the cloud itself for each spacing of points that cast shadows themselves."""
DISC_MAP_CELLS_PER_SPACING = 3.0
"""Cells of these shadow maps for each spacing of points whose discs cast shadows."""
POINT_BALL_SPACINGS = 0.7
"""Radius of the ball that a point counts as where a light sample elongates its shadow, in spacings."""
DISC_BALL_SPACINGS = 0.2
"""The same for each sample point of a disc."""
UNERODED_SHARE_PER_CELL = 0.4
"""Share of light samples whose shadows are not eroded, for each cell that points lie apart."""

FLOOR_LIGHT_SAMPLES = 64
"""Samples of the area light, a square number: one bit each."""
FLOOR_SKY_DIRECTIONS = 128
"""Directions of the sky: one bit each in two passes of 64. For clouds of more than `MAX_SKY_POINTS` there are twice as
many, in four passes: fewer leave blotches in faint shadows that denser points would not show."""
MAX_SKY_POINTS = 10_000
"""Points that occlude the sky: of a larger cloud every n-th point is enough, as this shadow is soft."""
LIGHT_BLUR_CELLS = 2
"""Cells to every side over which the steps between light samples in a penumbra are averaged, at most."""
SKY_BLUR_CELLS = 3
"""The same for the steps between directions of the sky."""
SKY_DISTANCE = 50.0
"""Distance of a light sample that stands for a direction, in world units."""


class FloorOcclusion(NamedTuple):
    """Shares (S, S) float32 in [0, 1] of light that the cloud hides from the floor's cells, row by row along +Y."""

    light: np.ndarray
    """Share of the area light."""
    sky: np.ndarray
    """Share of the sky's irradiance."""


def is_sparse(spacing: float) -> bool:
    """Whether points of that spacing lie so far apart that their discs cast better shadows than they themselves."""
    return spacing >= SPARSE_MIN_CELLS * MIN_FLOOR_CELL


def shadow_casters(
    points: np.ndarray, spacing: float, surfels: SurfacePoints, radii: np.ndarray, use_discs: bool
) -> native.ShadowCasters:  # fmt: skip
    """What casts the shadows of points (N, 3) of that spacing: themselves, or sample points of their surfels' discs.

    The first N of the surfels, whose radii are (M,), belong to the points; the others close holes.
    """
    own = np.arange(len(points), dtype=np.int32)
    if not use_discs:
        return native.ShadowCasters(points, own, spacing / POINT_MAP_CELLS_PER_SPACING)
    nearest_to_holes = surfels.neighbors[len(points) :, 0]  # a surfel in a hole belongs to the point nearest to it
    owners = np.repeat(np.concatenate([own, nearest_to_holes]), SAMPLES_PER_DISC)
    return native.ShadowCasters(disc_sample_points(surfels, radii), owners, spacing / DISC_MAP_CELLS_PER_SPACING)


def floor_occlusion(
    points: np.ndarray, spacing: float, casters: native.ShadowCasters, light: tuple[float, float, float], height: float,
    sets: int, use_discs: bool, sky_directions: int = FLOOR_SKY_DIRECTIONS, sky: np.ndarray | None = None,
) -> FloorOcclusion:  # fmt: skip
    """How much light points (N, 3) of that spacing hide from a floor at that height; both cores work on it.

    The area light's shadow is that of the casters, which are sample points of discs if `use_discs`; `sets` (1, 2 or 4)
    jittered sets of samples stand for it. The sky's is that of the points themselves; it does not depend on the light,
    so that `sky` of an earlier result for another light may be given, and is then taken over.
    """
    if use_discs:
        cells, eroded, ball = _cell_count(spacing / DISC_CELLS_PER_SPACING), 1.0, DISC_BALL_SPACINGS
    else:
        cells, ball = _cell_count(spacing / POINT_CELLS_PER_SPACING), POINT_BALL_SPACINGS
        eroded = eroded_share(spacing, cells)
    occlusion_of = partial(
        native.floor_occlusion, casters.positions, floor_height=height,
        half_size=FLOOR_HALF_WIDTH, side=cells, eroded_share=eroded, ball_radius=ball * spacing,
        blur_cells=LIGHT_BLUR_CELLS, area_light=area_light_quad(light),
    )  # fmt: skip
    passes: list[Callable[[], np.ndarray]] = [
        partial(occlusion_of, positions) for positions in jittered_sample_sets(light, FLOOR_LIGHT_SAMPLES, sets)
    ]
    if sky is None:
        passes += _sky_occlusion_passes(points, spacing, height, sky_directions)
    parts = parallel_map(passes)
    light_parts, sky_parts = parts[:sets], parts[sets:]
    if sky is None:
        sky = native.resample_grid(sum(sky_parts[1:], sky_parts[0]) / np.float32(len(sky_parts)), cells)
    return FloorOcclusion(sum(light_parts[1:], light_parts[0]) / np.float32(sets), sky)


def eroded_share(spacing: float, cells: int) -> float:
    """Share in [0, 1] of light samples whose shadows are eroded by a cell, for points of that spacing.

    `cells` is the number of cells along a side of the floor.
    """
    return max(1 - UNERODED_SHARE_PER_CELL * spacing * cells / (2 * FLOOR_HALF_WIDTH), 0)


def _sky_occlusion_passes(
    points: np.ndarray, spacing: float, height: float, count: int
) -> list[Callable[[], np.ndarray]]:  # fmt: skip
    """Passes that each give the share (Q, Q) that points (N, 3) hide of a part of the sky: one half of `count`
    directions, or a quarter of twice as many for more than `MAX_SKY_POINTS`.
    """
    stride = -(-len(points) // MAX_SKY_POINTS)
    parts = 2 if stride == 1 else 4
    cells = _cell_count(spacing * math.sqrt(stride) / POINT_CELLS_PER_SPACING)
    directions, subset = SKY_DISTANCE * cosine_hemisphere(count * parts // 2), points[::stride]
    return [
        partial(native.floor_occlusion, subset, directions[part::parts], height, FLOOR_HALF_WIDTH, cells, 1.0,
                blur_cells=SKY_BLUR_CELLS)
        for part in range(parts)
    ]  # fmt: skip


def _cell_count(width: float) -> int:
    """Cells of about that width along a side of the floor: at most `MAX_FLOOR_CELLS`, and at least 2 to interpolate."""
    return max(min(MAX_FLOOR_CELLS, int(2 * FLOOR_HALF_WIDTH / max(width, MIN_FLOOR_CELL))), 2)
