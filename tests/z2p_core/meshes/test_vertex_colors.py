"""Vertices get the colors of the points around them."""

from __future__ import annotations

import numpy as np

from z2p_core.meshes.vertex_colors import interpolate_colors

RNG = np.random.default_rng(0)
CLOUD = RNG.normal(size=(500, 3))
COLORS = RNG.uniform(size=(500, 3))


def test_a_vertex_at_a_point_has_its_color() -> None:
    order = RNG.permutation(500)
    np.testing.assert_allclose(interpolate_colors(CLOUD[order], CLOUD, COLORS), COLORS[order], atol=1e-4)


def test_between_points_colors_are_between_theirs() -> None:
    ends = np.array([[0.0, 0, 0], [1, 0, 0]])
    middle = interpolate_colors(np.array([[0.5, 0, 0], [0.2, 0, 0]]), ends, np.array([[0.0, 0, 0], [1, 0.5, 0]]))
    np.testing.assert_allclose(middle[0], [0.5, 0.25, 0], atol=1e-6)
    assert 0 < middle[1, 0] < 0.1


def test_points_at_one_place_share_their_mean() -> None:
    colors = interpolate_colors(np.zeros((1, 3)), np.zeros((2, 3)), np.array([[0.0, 0, 0], [1, 1, 1]]))
    np.testing.assert_allclose(colors, [[0.5, 0.5, 0.5]])


def test_colors_stay_in_their_range_far_away() -> None:
    far = interpolate_colors(CLOUD * 5, CLOUD, COLORS)
    assert far.dtype == np.float32 and far.min() >= 0 and far.max() <= 1
