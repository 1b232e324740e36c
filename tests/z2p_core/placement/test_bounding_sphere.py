"""The bounding sphere holds every point and is the smallest; rotations are rotations, spread over all of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from z2p_core.placement.bounding_sphere import Sphere, bounding_sphere
from z2p_core.rotations import random_rotation

clouds = hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-1000, 1000, width=32))
UTM = np.array([5e6, -5e6, 5e6])


def reach(points: np.ndarray, sphere: Sphere) -> float:
    return float(np.linalg.norm(points - np.array(sphere.centre), axis=1).max())


def extent(points: np.ndarray) -> float:
    return float(np.linalg.norm(points.max(0) - points.min(0)))


@given(clouds)
def test_every_point_is_inside(points: np.ndarray) -> None:
    sphere = bounding_sphere(points)
    assert reach(points, sphere) <= sphere.radius * (1 + 1e-9) + 1e-9


@given(clouds)
def test_the_radius_lies_between_the_bounds_that_geometry_gives(points: np.ndarray) -> None:
    radius = bounding_sphere(points).radius
    diameter = float(np.linalg.norm(points[:, None] - points[None], axis=2).max())
    assert diameter / 2 <= radius * (1 + 1e-9) + 1e-9
    assert radius <= diameter * math.sqrt(3 / 8) * (1 + 1e-6) + 1e-9  # Jung's theorem in three dimensions


@given(clouds)
def test_moving_the_cloud_by_utm_offsets_moves_the_sphere_alone(points: np.ndarray) -> None:
    here, there = bounding_sphere(points), bounding_sphere(points + UTM)
    slack = 1e-8 * 5e6 + 1e-6 * extent(points)  # of the sum's own rounding
    assert there.radius == pytest.approx(here.radius, abs=slack)
    np.testing.assert_allclose(np.array(there.centre) - UTM, here.centre, atol=10 * slack)


@given(st.integers(0, 2**32), st.floats(1e-3, 1e6), st.integers(0, 300))
def test_points_on_a_known_sphere_and_inside_it_give_that_sphere(seed: int, radius: float, inner: int) -> None:
    rng = np.random.default_rng(seed)
    tetrahedron = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / math.sqrt(3)
    filling = rng.normal(size=(inner, 3))
    filling *= rng.uniform(0, 1, (inner, 1)) / np.linalg.norm(filling, axis=1, keepdims=True)
    centre = rng.uniform(-1, 1, 3) * radius
    points = rng.permutation(np.vstack([tetrahedron @ random_rotation(rng).T, filling])) * radius + centre
    sphere = bounding_sphere(points)
    assert sphere.radius == pytest.approx(radius, rel=1e-6)
    np.testing.assert_allclose(sphere.centre, centre, atol=1e-6 * radius)


@pytest.mark.parametrize(
    ("points", "centre", "radius"),
    [
        ([[3, 4, 5]], (3, 4, 5), 0),
        ([[3, 4, 5]] * 7, (3, 4, 5), 0),
        ([[0, 0, 0], [2, 0, 0], [1, 0.5, 0]], (1, 0, 0), 1),
        ([[x, y, z] for x in (0, 2) for y in (0, 2) for z in (0, 2)], (1, 1, 1), math.sqrt(3)),
        ([[t, 2 * t, -t] for t in range(11)], (5, 10, -5), 5 * math.sqrt(6)),
        ([[math.cos(t), math.sin(t), 0] for t in np.linspace(0, 6, 50)], (0, 0, 0), 1),
        ([[0, 0, 0], [1e-7, 0, 0], [1, 0, 0]], (0.5, 0, 0), 0.5),
    ],
)
def test_constructed_cases(points: list[list[float]], centre: tuple[float, ...], radius: float) -> None:
    sphere = bounding_sphere(np.array(points, dtype=np.float64))
    assert sphere.radius == pytest.approx(radius, abs=1e-6)
    np.testing.assert_allclose(sphere.centre, centre, atol=1e-6)


def test_the_order_of_points_does_not_matter() -> None:
    rng = np.random.default_rng(5)
    points = rng.normal(size=(500, 3))
    first, second = bounding_sphere(points), bounding_sphere(rng.permutation(points))
    np.testing.assert_allclose([*first.centre, first.radius], [*second.centre, second.radius], atol=1e-9)


def test_normalization_keeps_precision_far_from_the_origin() -> None:
    points = np.random.default_rng(3).uniform(-1, 1, (1000, 3))
    near = bounding_sphere(points).normalise(points)
    far = bounding_sphere(points + UTM).normalise(points + UTM)
    assert near.dtype == far.dtype == np.float32
    assert np.linalg.norm(near, axis=1).max() == pytest.approx(1, abs=1e-6)
    np.testing.assert_allclose(near, far, atol=1e-6)


@given(st.integers(0, 2**32))
def test_a_random_rotation_is_a_rotation(seed: int) -> None:
    rotation = random_rotation(np.random.default_rng(seed))
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_array_equal(rotation, random_rotation(np.random.default_rng(seed)))


def test_random_rotations_are_uniform() -> None:
    rng = np.random.default_rng(1)
    rotations = np.array([random_rotation(rng) for _ in range(4000)])
    np.testing.assert_allclose(rotations.mean(0), 0, atol=0.04)
    np.testing.assert_allclose((rotations**2).mean(0), 1 / 3, atol=0.03)
    # the angle's density is (1 - cos t) / pi, so its cosine's mean is -1/2, that is a mean trace of 0
    assert np.trace(rotations, axis1=1, axis2=2).mean() == pytest.approx(0, abs=0.07)
