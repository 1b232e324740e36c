"""Occlusion of the floor and of points matches ray casting, at every density of the cloud."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import sphere

from z2p_core import native
from z2p_core.shading.area_light import area_light_samples, cosine_hemisphere
from z2p_core.shading.floor_occlusion import FLOOR_HALF_WIDTH, eroded_share, floor_occlusion, is_sparse, shadow_casters
from z2p_core.shading.surfels import disc_sample_points, make_surfels
from z2p_core.surface.normals import estimate_surface

LIGHT, HEIGHT, RADIUS = (3.6, 30.0, 50.0), -0.6, 0.5


def occlusion_of_ball(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Occlusion of the area light and of the sky below a ball of `count` random points around the origin."""
    surface = estimate_surface(np.float32(sphere(count) * RADIUS))
    spacing = float(np.median(surface.spacing))
    surfels, radii = make_surfels(surface, spacing)
    use_discs = is_sparse(spacing)
    casters = shadow_casters(surface.points, spacing, surfels, radii, use_discs)
    return floor_occlusion(surface.points, spacing, casters, LIGHT, HEIGHT, 1, use_discs)


def hidden(side: int, step: int, directions: np.ndarray) -> np.ndarray:
    """Share of rays along `directions` (L, 3) that hit the ball, from every `step`-th of (side, side) floor cells."""
    x, y = np.meshgrid(*[(((np.arange(side) + 0.5) / side * 2 - 1) * FLOOR_HALF_WIDTH)[::step]] * 2)
    positions = np.stack([x, y, np.full_like(x, HEIGHT)], -1).astype(np.float32)
    hits = np.zeros(x.shape)
    for direction in directions.astype(np.float32):
        rays = direction - positions if np.linalg.norm(direction) > 1.5 else direction[None, None]
        rays = rays / np.linalg.norm(rays, axis=2, keepdims=True)
        nearest = -(positions * rays).sum(2)
        hits += (nearest > 0) & ((positions**2).sum(2) - nearest**2 < RADIUS**2)
    return hits / len(directions)


@pytest.mark.slow
@pytest.mark.parametrize("count", [500, 2_000, 6_000, 12_000, 40_000])
def test_floor_occlusion_of_a_ball_matches_ray_casting(count: int) -> None:
    light, sky = occlusion_of_ball(count)
    side, step = len(light), 1 + len(light) // 256  # a regular subset of the cells
    light, sky = light[::step, ::step], sky[::step, ::step]
    true_light = hidden(side, step, area_light_samples(LIGHT, 256)[0])
    assert light.sum() == pytest.approx(true_light.sum(), rel=0.06)
    assert np.abs(light - true_light).sum() < 0.1 * true_light.sum()
    true_sky = hidden(side, step, cosine_hemisphere(512))
    assert sky.sum() == pytest.approx(true_sky.sum(), rel=0.1)
    assert np.abs(sky - true_sky).sum() < 0.25 * true_sky.sum()


def test_points_farther_apart_than_the_floor_hide_nothing() -> None:
    surface = estimate_surface(np.float32(sphere(12) * 100))
    surfels, radii = make_surfels(surface, 100.0)
    casters = shadow_casters(surface.points, 100.0, surfels, radii, True)
    for occlusion in floor_occlusion(surface.points, 100.0, casters, LIGHT, -100.0, 1, True):
        assert occlusion.shape == (2, 2) and not occlusion.any()


def test_disc_samples_form_a_cross_in_the_discs_plane() -> None:
    surface = estimate_surface(np.float32(sphere(800)))
    surfels, radii = make_surfels(surface, float(np.median(surface.spacing)))
    middles, *places = disc_sample_points(surfels, radii).reshape(-1, 5, 3).swapaxes(0, 1)
    assert np.array_equal(middles, surfels.points)
    away = np.stack(places) - middles
    lengths = np.linalg.norm(away, axis=2)
    np.testing.assert_allclose(lengths / radii, lengths[0, 0] / radii[0], rtol=1e-4)
    assert np.abs(np.einsum("kna,na->kn", away, surfels.normals)).max() < 1e-5
    np.testing.assert_allclose(away.sum(0), 0, atol=1e-6)
    assert np.abs(np.einsum("na,na->n", away[0], away[2])).max() < 1e-6


def test_eroded_share_falls_with_spacing() -> None:
    shares = [eroded_share(spacing, 450) for spacing in (0.0, 0.01, 0.03, 1.0)]
    assert shares[0] == 1 > shares[1] > shares[2] > shares[3] == 0


def shade_below_a_plate(count: int, gap: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Share of light that points (L,) below a plate of points lose to it, to an exact plate, and that it loses itself.

    The plate reaches 0.25 to every side of the origin and lies `gap` above a larger one, which reaches 0.6.
    """
    rng, above = np.random.default_rng(0), count // 7
    flat = np.concatenate([rng.uniform(-0.25, 0.25, (above, 2)), rng.uniform(-0.6, 0.6, (count - above, 2))])
    surface = estimate_surface(np.float32(np.column_stack([flat, np.where(np.arange(count) < above, 0, -gap)])))
    spacing = float(np.median(surface.spacing))
    surfels, radii = make_surfels(surface, spacing)
    up, samples = surface.normals * np.sign(surface.normals[:, 2:]), area_light_samples(LIGHT, 16)
    casters = shadow_casters(surface.points, spacing, surfels, radii, is_sparse(spacing))
    light = native.direct_lighting(surface.points, up, casters, *samples, spacing, 1.0)[0]
    given, left = np.zeros((2, count))
    for position, axis, power in zip(*samples, strict=True):
        to_light = position - surface.points
        distance = np.linalg.norm(to_light, axis=1)
        irradiance = power * to_light[:, 2] * np.abs(to_light @ axis) / distance**4
        through = np.abs(surface.points + to_light * (-surface.points[:, 2] / to_light[:, 2])[:, None])
        given += irradiance
        left += irradiance * ((through[:, :2] > 0.25).any(1) | (surface.points[:, 2] > -gap / 2))
    lower = surface.points[:, 2] < -gap / 2
    return 1 - (light / given)[lower], 1 - (left / given)[lower], 1 - (light / given)[~lower]


@pytest.mark.parametrize("count", [500, 1_500, 5_000, 12_000, 40_000])
def test_a_plate_of_points_casts_the_shadow_of_a_plate(count: int) -> None:
    for gap in (0.1, 0.3):
        lost, true, own = shade_below_a_plate(count, gap)
        assert lost.sum() == pytest.approx(true.sum(), rel=0.08)
        assert np.abs(lost - true).sum() < 0.14 * true.sum() and own.mean() < 0.02
        assert (own > 0.5).sum() <= 1  # the smallest plate has 71 points: the normal of one at its rim may be off


def test_shadow_begins_two_spacings_below_its_caster() -> None:
    lost, true, own = shade_below_a_plate(5_000, 0.036)
    assert lost.sum() == pytest.approx(true.sum(), rel=0.1) and own.mean() < 0.02
