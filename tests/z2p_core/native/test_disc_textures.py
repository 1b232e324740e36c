"""Textures of discs: curves between two colors and gradients, fitted and drawn, against numpy and plain geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from z2p_core import native
from z2p_core.camera import Camera

RED, BLUE = (0.7, 0.1, 0.1), (0.05, 0.1, 0.6)
FACING = np.float32([0, 0, -1])
"""Normal of a disc that faces the camera."""


def flat_discs(count: int = 400, radius: float = 0.12, seed: int = 0) -> tuple[native.Discs, np.ndarray]:
    """Discs that face the camera in the square of side 2 about its axis, at depth 3; and 16 neighbors of each."""
    positions = np.random.default_rng(seed).uniform(-1, 1, (count, 2))
    centers = np.column_stack([positions, np.full(count, 3)]).astype(np.float32)
    neighbors = ((positions[:, None] - positions) ** 2).sum(2).argsort(1)[:, :16].astype(np.int32)
    planes = np.tile(np.float32([0, 0, 0, math.inf]), (count, 4, 1))
    return native.Discs(centers, np.tile(FACING, (count, 1)), np.full(count, radius, np.float32), planes), neighbors


def fit(discs: native.Discs, neighbors: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    return native.fit_disc_textures(discs, neighbors, albedo, np.zeros_like(albedo), np.ones_like(albedo))


def draw(discs: native.Discs, textures: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Coverage (H, W) and colors (3, H, W)."""
    out, colors = np.zeros((9, 128, 128), np.float32), np.zeros((3, 128, 128), np.float32)
    blending = native.Blending(0.7, 15.0, 2.7)
    features = np.zeros((len(discs.centers), 6), np.float32)
    native.rasterize_surfels(discs, features, camera, blending, (1.0, 6.0), out, None, textures, colors)
    return out[0], colors


def two_colors(is_first: np.ndarray) -> np.ndarray:
    return np.where(is_first[:, None], RED, BLUE).astype(np.float32)


def curve_by_numpy(places: np.ndarray, is_first: np.ndarray) -> np.ndarray:
    """Coefficients of the curve between neighbors (K, 2) of both groups (K,)."""
    s, t = places.T
    weight, prior = np.exp(-(s**2 + t**2) / (2 * 1.2**2)), np.diag([1e-3, 5e-3, 5e-3, 0.07, 0.07, 0.07])
    terms, curve = np.stack([np.ones_like(s), s, t, s * s, s * t, t * t], 1), np.zeros(6)
    for _ in range(5):
        probability = 1 / (1 + np.exp(-terms @ curve))
        second = weight * np.maximum(probability * (1 - probability), 0.01)
        gradient = terms.T @ (weight * (is_first - probability)) - prior @ curve
        curve += np.linalg.solve((terms.T * second) @ terms + prior, gradient)
    return curve


def test_curves_are_those_of_a_logistic_regression() -> None:
    discs, neighbors = flat_discs()
    x, y, _ = discs.centers.T
    albedo = two_colors(x + 0.4 * np.sin(3 * y) > 0)
    textures = fit(discs, neighbors, albedo)
    edges = np.flatnonzero(np.abs(textures[:, 9:12]).max(1) > 0)
    assert len(edges) > 40
    for disc in edges[::5]:
        offsets = (discs.centers[neighbors[disc]] - discs.centers[disc]) / discs.radii[disc]
        u = np.cross(FACING, [1, 0, 0])  # as in tangent_basis() of common/vec3.h
        places = offsets @ np.stack([u, np.cross(FACING, u)], 1)
        is_first = albedo[neighbors[disc], 0] > 0.5
        if textures[disc, 9] < 0:
            is_first = ~is_first
        np.testing.assert_allclose(textures[disc, 12:], curve_by_numpy(places, is_first), rtol=2e-2, atol=2e-2)


def test_two_colors_meet_in_a_sharp_line() -> None:
    discs, neighbors = flat_discs(3000, 0.05)
    camera = Camera(128, 128)
    coverage, colors = draw(discs, fit(discs, neighbors, two_colors(discs.centers[:, 0] > 0)), camera)
    spacing = 2 / math.sqrt(3000) * camera.focal / 3
    for row in range(30, 98, 4):
        shown, covered = colors[:, row].T, coverage[row] > 0.99
        mixed = np.minimum(np.abs(shown - RED).max(1), np.abs(shown - BLUE).max(1)) > 0.05
        assert (mixed & covered).sum() <= 1 + spacing
        red = np.flatnonzero(covered & (shown[:, 0] > 0.4))
        assert abs(red.min() - 64) < 1.5 * spacing


def test_two_labels_never_mix_into_others() -> None:
    """Colors between the two lie on the straight line between them, and most pixels have one of the two."""
    discs, neighbors = flat_discs(1500, 0.07)
    labels = np.linalg.norm(discs.centers[:, :2] % 0.5 - 0.25, axis=1) < 0.15
    coverage, colors = draw(discs, fit(discs, neighbors, two_colors(labels)), Camera(128, 128))
    shown = colors[:, coverage > 0.99].T
    share = (shown[:, 0] - BLUE[0]) / (RED[0] - BLUE[0])
    np.testing.assert_allclose(shown, np.outer(share, RED) + np.outer(1 - share, BLUE), atol=1e-4)
    assert share.min() > -1e-4 and share.max() < 1 + 1e-4
    assert ((share > 0.05) & (share < 0.95)).mean() < 0.2


def test_gradients_are_drawn_as_they_are() -> None:
    discs, neighbors = flat_discs(1500, 0.07)
    camera = Camera(128, 128)
    ramp = (discs.centers[:, :1] + 1) / 2 * np.float32([0.8, 0.4, 0]) + np.float32(0.1)
    coverage, colors = draw(discs, fit(discs, neighbors, ramp), camera)
    x = (np.arange(128) + 0.5 - 64) / camera.focal * 3
    inside = (coverage > 0.99) & (np.abs(x) < 0.85) & (np.abs(x[:, None]) < 0.85)
    expected = np.broadcast_to((x + 1) / 2 * 0.8 + 0.1, (128, 128))
    error = np.abs(colors[0] - expected)[inside]
    assert error.max() < 0.05 and error.mean() < 0.004


def test_random_colors_stay_within_those_around() -> None:
    discs, neighbors = flat_discs(1500, 0.07)
    albedo = np.random.default_rng(3).uniform(0.2, 0.8, (1500, 3)).astype(np.float32)
    coverage, colors = draw(discs, fit(discs, neighbors, albedo), Camera(128, 128))
    shown = colors[:, coverage > 0.99]
    assert shown.min() > 0.2 - 1e-4 and shown.max() < 0.8 + 1e-4
    plain = np.zeros((1500, native.TEXTURE_VALUES), np.float32)
    plain[:, :3] = albedo
    constant = draw(discs, plain, Camera(128, 128))[1][:, coverage > 0.99]
    assert abs(shown.std() - constant.std()) < 0.3 * constant.std()


def test_one_color_is_one_color_for_all() -> None:
    discs, neighbors = flat_discs()
    albedo = np.tile(np.float32(RED), (400, 1))
    offset, slope = np.full_like(albedo, 0.25), np.full_like(albedo, 0.5)
    textures = native.fit_disc_textures(discs, neighbors, albedo, offset, slope)
    np.testing.assert_allclose(textures[:, :3], 0.25 + 0.5 * albedo)
    assert not textures[:, 3:].any()


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_neighbors_are_enough(count: int) -> None:
    discs, neighbors = flat_discs(40, 0.3)
    albedo = np.random.default_rng(0).random((40, 3), np.float32)
    assert np.isfinite(fit(discs, np.ascontiguousarray(neighbors[:, :count]), albedo)).all()


def test_colors_of_tilted_discs_lie_where_their_points_are() -> None:
    camera, normal = Camera(128, 128), np.float32([0.6, 0, -0.8])
    along = np.float32([0.8, 0, 0.6])
    planes = np.tile(np.float32([0, 0, 0, math.inf]), (1, 4, 1))
    discs = native.Discs(np.float32([[0, 0, 3]]), normal[None], np.float32([0.5]), planes)
    u = np.cross(normal, [1, 0, 0])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    texture = np.zeros((1, native.TEXTURE_VALUES), np.float32)
    texture[0, 9:12] = 1  # 1 where the curve's function is positive, -1 elsewhere
    texture[0, 12:15] = -0.25, along @ u, along @ v  # positive a quarter of the radius away from the center
    coverage, colors = draw(discs, texture, camera)
    row = colors[0, 64, coverage[64] > 0.99]
    columns = np.flatnonzero(coverage[64] > 0.99)
    edge = np.float32([0, 0, 3]) + 0.125 * along
    assert columns[row > 0].min() == pytest.approx(64 + camera.focal * edge[0] / edge[2], abs=1.5)
