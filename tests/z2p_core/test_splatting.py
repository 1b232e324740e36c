"""The splatting kernels against plain numpy, point for point and window for window."""

import os

import numpy as np
import pytest
from splatting_reference import nearest_depth as reference_depth
from splatting_reference import window_minimum as reference_minimum

from z2p_core.camera import Camera
from z2p_core.splatting import MIN_POINTS_PER_THREAD, nearest_depth, window_minimum

CAMERAS = [Camera(64, 64), Camera(97, 61, 0.0), Camera(33, 130, 75.0), Camera(512, 512, 30.0)]


def cloud_of(count, spread=1.0, seed=0):
    return np.random.default_rng(seed).uniform(-spread, spread, (count, 3)).astype(np.float32)


def assert_equal_up_to_rounding(found, expected, points):
    """Equal depths, but for a few points that rounding puts on the other side of a pixel's border."""
    assert found.shape == expected.shape and found.dtype == np.float32
    close = np.isclose(found, expected, rtol=2e-6, atol=0)
    assert (~close).sum() <= 2 + points * 2e-5
    for row, column in np.argwhere(~close):
        around = np.s_[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        assert np.isclose(found[around].min(), expected[around].min(), rtol=1e-5)


@pytest.mark.parametrize("camera", CAMERAS, ids=str)
@pytest.mark.parametrize(("count", "spread"), [(1, 0.1), (511, 1.0), (5000, 1.0), (20_000, 4.0)])
@pytest.mark.parametrize("margin", [0, 6])
def test_nearest_depth_matches_the_numpy_reference(camera, count, spread, margin):
    cloud = cloud_of(count, spread)  # a spread of 4 has points beside and behind the camera
    found = nearest_depth(cloud, camera, margin)
    assert np.isfinite(found).any()
    assert_equal_up_to_rounding(found, reference_depth(cloud, camera, margin), count)


def test_empty_clouds_and_nonfinite_points_draw_nothing():
    odd = np.array([[np.nan, 0, 0], [np.inf, 0, 0], [0, -np.inf, 0], [0, 0, np.nan], [1e30, -1e30, 1e30]], np.float32)
    for cloud in (odd, odd[:0]):
        assert np.isinf(nearest_depth(cloud, CAMERAS[0], 2)).all()
    cloud = cloud_of(300)
    np.testing.assert_array_equal(nearest_depth(np.concatenate([odd, cloud]), CAMERAS[0]),
                                  nearest_depth(cloud, CAMERAS[0]))  # fmt: skip


def test_points_in_the_cameras_plane_are_dropped():
    camera = Camera(64, 64, 0.0)
    assert np.isinf(nearest_depth(np.float32([[0, -3.6, 0], [0.5, -3.6, 0.1], [0, -9, 0]]), camera)).all()


def test_threads_draw_the_same_as_one(monkeypatch):
    cloud, camera = cloud_of(3 * MIN_POINTS_PER_THREAD + 17), CAMERAS[3]
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    alone = nearest_depth(cloud, camera, 3)
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    np.testing.assert_array_equal(nearest_depth(cloud, camera, 3), alone)
    assert_equal_up_to_rounding(alone, reference_depth(cloud, camera, 3), len(cloud))


@pytest.mark.parametrize("layout", ["C", "F", "strided", "float64"])
def test_the_layout_of_the_points_does_not_matter(layout):
    cloud = cloud_of(1000)
    other = {"C": cloud, "F": np.asfortranarray(cloud), "float64": cloud.astype(np.float64),
             "strided": np.repeat(cloud, 2, axis=0)[::2]}[layout]  # fmt: skip
    np.testing.assert_array_equal(nearest_depth(other, CAMERAS[0]), nearest_depth(cloud, CAMERAS[0]))


@pytest.mark.parametrize("size", [1, 2, 3, 5, 7, 9, 13])
@pytest.mark.parametrize("shape", [(13, 13), (40, 57), (130, 33)])
def test_window_minimum_matches_the_numpy_reference(size, shape):
    rng = np.random.default_rng(size)
    picture = rng.uniform(2, 5, shape).astype(np.float32)
    picture[rng.random(shape) < 0.8] = np.inf
    given = picture.copy()
    expected = reference_minimum(picture, size)
    np.testing.assert_array_equal(window_minimum(picture, size), expected)
    np.testing.assert_array_equal(window_minimum(picture[::-1, ::-1], size), expected[::-1, ::-1])
    np.testing.assert_array_equal(picture, given)
