"""Light on clouds whose points have albedos of their own, relative to the same cloud in one neutral color.

Albedo demodulation: the network renders the cloud in one neutral color, and its picture is multiplied, in linear light,
by the radiance of the textured surface over that of the neutral one. So light is filtered, and texture is not. Light
that surfaces send to each other carries their colors.

Arrays (2, N, ...) hold a value for both sides of each point, as in `z2p_core.shading.light_transport`.
"""

from __future__ import annotations

import numpy as np

from z2p_core import native
from z2p_core.interfaces import PointColors
from z2p_core.linalg import row_dots
from z2p_core.shading.area_light import hemisphere_axes
from z2p_core.shading.light_transport import BouncedLight, LightScene, Quality, sending_to_floor
from z2p_core.surface.normals import SurfacePoints

NEUTRAL_GREY = 0.35
"""Linear color in which clouds of several colors are rendered: no light makes it white, and it is bright enough for
the network. Pictures of 5,000 textured points are 0.5 to 1.3 dB worse with 0.6 and up to 0.5 dB worse with 0.12."""
UNIFORM_SPREAD = 0.1
"""Standard deviation of the albedo from which on the neutral color is that grey. Below, it is nearer to the cloud's
mean, so that a cloud of one color is rendered in that color."""
MAX_STATISTICS_POINTS = 5_000
"""Points from whose albedo the neutral color is computed, at most."""
MIN_BOUNCED_RADIANCE = 1e-6
"""Least radiance of the first bounce that the second one is compared to."""
MAX_COLOR_DISTANCE = 0.08
"""Distance from the nearest surface point beyond which a color belongs to no part of the surface, in world units: it is
more than the radius of the balls of very small clouds, and less than the distance of outliers."""
MAX_COLOR_DISTANCE_SPACINGS = 4.0
"""The same in spacings; the larger of both counts."""
COLORS_PER_POINT = 5
"""Colors for each surface point of which its mean is taken; more make no difference."""
MAX_SPREAD_ROUNDS = 32
"""Steps from neighbor to neighbor over which colors spread to surface points that have none."""


def neutral_albedo(albedo: np.ndarray) -> np.ndarray:
    """Linear color (3,) float32 in which the network renders a cloud with albedos (N, 3)."""
    sample = albedo[:: -(-len(albedo) // MAX_STATISTICS_POINTS)].T.astype(np.float64)
    mean = sample.mean(axis=1)
    share = min(float(sample.std(axis=1).max()) / UNIFORM_SPREAD, 1.0)
    color: np.ndarray = (mean + share * (NEUTRAL_GREY - mean)).astype(np.float32)
    return color


def surface_albedo(surface: SurfacePoints, colors: PointColors) -> np.ndarray:
    """Albedo (N, 3) float32 of a surface's points: the mean of the colors to which each is the nearest point.

    Points that are nearest to no color get the mean of their neighbors'.
    """
    count = len(surface.points)
    step = max(len(colors.points) // (COLORS_PER_POINT * count), 1)
    if step > 1:
        colors = PointColors(colors.points[::step], colors.albedo[::step], colors.relight)
    nearest = surface.grid.nearest_to_positions(colors.points)
    offsets = surface.grid.points[nearest] - colors.points
    if len(nearest) == count and not offsets.any() and (np.bincount(nearest) == 1).all():
        albedo = np.empty((count, 3), np.float32)
        albedo[nearest] = colors.albedo
        return albedo
    limit = np.maximum(MAX_COLOR_DISTANCE, MAX_COLOR_DISTANCE_SPACINGS * surface.spacing[nearest])
    on_surface = row_dots(offsets, offsets) <= limit**2
    nearest, albedo = nearest[on_surface], colors.albedo[on_surface]
    number = np.bincount(nearest, minlength=count)
    sums = [np.bincount(nearest, channel, count) for channel in albedo.T]
    means = (np.stack(sums, axis=1) / np.maximum(number, 1)[:, None]).astype(np.float32)
    return _spread_to_unknown(means, number > 0, surface.neighbors, colors.albedo.mean(axis=0))


def _spread_to_unknown(
    values: np.ndarray, known: np.ndarray, neighbors: np.ndarray, default: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Values (N, 3); rows that are not `known` (N,) get means of known neighbors (N, K), or the default (3,)."""
    values, known = values.copy(), known.copy()
    for _ in range(MAX_SPREAD_ROUNDS):
        unknown = np.flatnonzero(~known)
        if not len(unknown):
            return values
        weights = known[neighbors[unknown]].astype(np.float32)
        reached = weights.sum(axis=1) > 0
        weights, unknown = weights[reached], unknown[reached]
        values[unknown] = np.einsum("nk,nkc->nc", weights, values[neighbors[unknown]]) / weights.sum(1, keepdims=True)
        known[unknown] = True
    values[~known] = default
    return values


def textured_radiance(
    scene: LightScene, bounced: BouncedLight, albedo: np.ndarray, point_visibility: np.ndarray,
    floor_visibility: np.ndarray, quality: Quality,
) -> np.ndarray:  # fmt: skip
    """Radiance (N, 3) of white points amid points with these albedos (N, 3), on the side that the normals point to.

    `bounced` is the light of the same scene for white points. The first bounce carries the points' colors; later ones
    are taken to be as large, compared to the first one, as between white points, times the cloud's mean albedo.
    """
    cloud = (scene.points, scene.normals, hemisphere_axes(quality.sky_axes), point_visibility)
    unbounced, first, second = bounced.points
    mean = albedo.mean(axis=0)
    growth = second[0] / np.maximum(first[0], MIN_BOUNCED_RADIANCE)
    sent = albedo * unbounced[:, :, None]
    floor = native.floor_colors(sending_to_floor(sent), floor_visibility, scene.irradiance_cells)
    received = native.gather_colors(*cloud, sent, scene.floor, floor)
    later = mean / (1 - bounced.last_ratio * mean)
    total: np.ndarray = unbounced[0][:, None] + received * (1 + later * growth[:, None])
    return total
