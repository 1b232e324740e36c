"""Shade is neither more nor less than what is truly hidden, however far apart the points lie."""

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


def shades_of(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Shade of the lamp and of the sky below a ball about the origin of so many random points."""
    found = estimate_surface(np.float32(sphere(count) * RADIUS))
    spacing = float(np.median(found.spacing))
    further, radii = make_surfels(found, spacing)
    apart = is_sparse(spacing)
    casters = shadow_casters(found.points, spacing, further, radii, apart)
    return floor_occlusion(found.points, spacing, casters, LIGHT, HEIGHT, 1, apart)


def hidden(side: int, step: int, ways: np.ndarray) -> np.ndarray:
    """Share of rays that meet the ball, from every so many of a floor's (side, side) cells along `ways` (L, 3)."""
    x, y = np.meshgrid(*[(((np.arange(side) + 0.5) / side * 2 - 1) * FLOOR_HALF_WIDTH)[::step]] * 2)
    places = np.stack([x, y, np.full_like(x, HEIGHT)], -1).astype(np.float32)
    met = np.zeros(x.shape)
    for way in ways.astype(np.float32):
        rays = way - places if np.linalg.norm(way) > 1.5 else way[None, None]
        rays = rays / np.linalg.norm(rays, axis=2, keepdims=True)
        nearest = -(places * rays).sum(2)
        met += (nearest > 0) & ((places**2).sum(2) - nearest**2 < RADIUS**2)
    return met / len(ways)


@pytest.mark.parametrize("count", [500, 2_000, 6_000, 12_000, 40_000])
def test_floor_occlusion_of_a_ball_matches_ray_casting(count: int) -> None:
    lamp, sky = shades_of(count)
    side, step = len(lamp), 1 + len(lamp) // 256  # some of the cells, evenly spread, stand for all
    lamp, sky = lamp[::step, ::step], sky[::step, ::step]
    true = hidden(side, step, area_light_samples(LIGHT, 256)[0])
    assert lamp.sum() == pytest.approx(true.sum(), rel=0.06)
    assert np.abs(lamp - true).sum() < 0.1 * true.sum()
    clear = hidden(side, step, cosine_hemisphere(512))
    assert sky.sum() == pytest.approx(clear.sum(), rel=0.1)
    assert np.abs(sky - clear).sum() < 0.25 * clear.sum()


def test_points_farther_apart_than_the_floor_hide_nothing() -> None:
    found = estimate_surface(np.float32(sphere(12) * 100))
    further, radii = make_surfels(found, 100.0)
    casters = shadow_casters(found.points, 100.0, further, radii, True)
    for shade in floor_occlusion(found.points, 100.0, casters, LIGHT, -100.0, 1, True):
        assert shade.shape == (2, 2) and not shade.any()


def test_disc_samples_form_a_cross_in_the_discs_plane() -> None:
    found = estimate_surface(np.float32(sphere(800)))
    further, radii = make_surfels(found, float(np.median(found.spacing)))
    middles, *places = disc_sample_points(further, radii).reshape(-1, 5, 3).swapaxes(0, 1)
    assert np.array_equal(middles, further.points)
    away = np.stack(places) - middles
    lengths = np.linalg.norm(away, axis=2)
    np.testing.assert_allclose(lengths / radii, lengths[0, 0] / radii[0], rtol=1e-4)
    assert np.abs(np.einsum("kna,na->kn", away, further.normals)).max() < 1e-5
    np.testing.assert_allclose(away.sum(0), 0, atol=1e-6)
    assert np.abs(np.einsum("na,na->n", away[0], away[2])).max() < 1e-6


def test_eroded_share_falls_with_spacing() -> None:
    shares = [eroded_share(spacing, 450) for spacing in (0.0, 0.01, 0.03, 1.0)]
    assert shares[0] == 1 > shares[1] > shares[2] > shares[3] == 0


def shade_below_a_plate(count: int, gap: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Share of the light that points (L,) below a plate of points have lost to it, and to a true plate; and of its own.

    The plate reaches 0.25 to every side of the origin, so far above one that reaches 0.6.
    """
    rng, above = np.random.default_rng(0), count // 7
    flat = np.concatenate([rng.uniform(-0.25, 0.25, (above, 2)), rng.uniform(-0.6, 0.6, (count - above, 2))])
    found = estimate_surface(np.float32(np.column_stack([flat, np.where(np.arange(count) < above, 0, -gap)])))
    spacing = float(np.median(found.spacing))
    further, radii = make_surfels(found, spacing)
    up, lamps = found.normals * np.sign(found.normals[:, 2:]), area_light_samples(LIGHT, 16)
    casters = shadow_casters(found.points, spacing, further, radii, is_sparse(spacing))
    light = native.direct_lighting(found.points, up, casters, *lamps, spacing, 1.0)[0]
    given, left = np.zeros((2, count))
    for lamp, axis, power in zip(*lamps, strict=True):
        way = lamp - found.points
        far = np.linalg.norm(way, axis=1)
        shone = power * way[:, 2] * np.abs(way @ axis) / far**4
        through = np.abs(found.points + way * (-found.points[:, 2] / way[:, 2])[:, None])
        given += shone
        left += shone * ((through[:, :2] > 0.25).any(1) | (found.points[:, 2] > -gap / 2))
    lower = found.points[:, 2] < -gap / 2
    return 1 - (light / given)[lower], 1 - (left / given)[lower], 1 - (light / given)[~lower]


@pytest.mark.parametrize("count", [500, 1_500, 5_000, 12_000, 40_000])
def test_a_plate_of_points_casts_the_shadow_of_a_plate(count: int) -> None:
    for gap in (0.1, 0.3):
        lost, true, own = shade_below_a_plate(count, gap)
        assert lost.sum() == pytest.approx(true.sum(), rel=0.08)
        assert np.abs(lost - true).sum() < 0.14 * true.sum() and own.mean() < 0.02
        assert (own > 0.5).sum() <= 1  # of 71 points at fewest, one at the rim may lean


def test_shadow_begins_two_spacings_below_its_caster() -> None:
    lost, true, own = shade_below_a_plate(5_000, 0.036)
    assert lost.sum() == pytest.approx(true.sum(), rel=0.1) and own.mean() < 0.02
