"""Z-buffers against a plain double loop of Eq. 1, and what must hold for any cloud."""

import math

import numpy as np
import pytest

from z2p_core.camera import DEPTH_RANGE, DISTANCE, FIELD_OF_VIEW, Camera
from z2p_core.splatting import INTENSITY_ALPHA as ALPHA
from z2p_core.splatting import INTENSITY_BETA as BETA
from z2p_renderer.plugins.zbuffers.paper import PaperZBuffer
from z2p_renderer.plugins.zbuffers.splats import SplatPyramid


def cloud_of(count, seed=0, spread=1.0):
    return np.random.default_rng(seed).uniform(-spread, spread, (count, 3)).astype(np.float32)


def eq1_by_loops(cloud, camera, window):
    """Eq. 1, one point and one pixel at a time."""
    picture = np.zeros((camera.height, camera.width), np.float32)
    pixels, depths = camera.project(cloud)
    reach = window // 2
    for (x, y), depth in zip(pixels, depths, strict=True):
        if depth <= 0:
            continue
        for row in range(math.floor(y) - reach, math.floor(y) + reach + 1):
            for column in range(math.floor(x) - reach, math.floor(x) + reach + 1):
                if 0 <= row < camera.height and 0 <= column < camera.width:
                    picture[row, column] = max(picture[row, column], math.exp(-(float(depth) - ALPHA) / BETA))
    return picture


@pytest.mark.parametrize("camera", [Camera(48, 48, 20.0), Camera(50, 33, 0.0), Camera(33, 47, 75.0)])
def test_paper_equals_eq1_by_loops_also_at_the_border(camera):
    cloud = cloud_of(300, spread=2.0)  # many points outside the picture and some just beside it
    np.testing.assert_allclose(PaperZBuffer().draw(cloud, camera)[0], eq1_by_loops(cloud, camera, 5), rtol=1e-5)


def test_window_of_a_point_outside_reaches_into_the_picture():
    camera = Camera(64, 64, 0.0)
    edge = DISTANCE * math.tan(math.radians(FIELD_OF_VIEW / 2))
    for beside, seen in ((1.5, True), (2.5, False)):
        point = np.array([[edge + beside * DISTANCE / camera.focal, 0, 0]], np.float32)
        assert PaperZBuffer().draw(point, camera).any() == seen


@pytest.mark.parametrize("zbuffer", [PaperZBuffer(), SplatPyramid()])
def test_point_order_does_not_matter(zbuffer):
    cloud, camera = cloud_of(500), Camera(64, 48)
    shuffled = cloud[np.random.default_rng(1).permutation(500)]
    np.testing.assert_array_equal(zbuffer.draw(cloud, camera), zbuffer.draw(shuffled, camera))


@pytest.mark.parametrize("zbuffer", [PaperZBuffer(), SplatPyramid()])
def test_nearest_point_wins_and_those_behind_are_dropped(zbuffer):
    camera = Camera(64, 64, 0.0)
    near, far = np.array([[0, -0.5, 0]], np.float32), np.array([[0, 0.5, 0]], np.float32)
    behind = np.array([[0, -5, 0], [0.1, -3.6, 0]], np.float32)  # the second in the camera's own plane
    alone = zbuffer.draw(near, camera)
    assert alone.any()
    np.testing.assert_array_equal(zbuffer.draw(np.concatenate([far, near, behind]), camera), alone)
    assert not zbuffer.draw(behind, camera).any()


@pytest.mark.parametrize("zbuffer", [PaperZBuffer(), SplatPyramid()])
def test_shape_type_range_and_empty_cloud(zbuffer):
    camera = Camera(40, 30)
    picture = zbuffer.draw(cloud_of(200, spread=0.5), camera)
    assert picture.shape == (zbuffer.channels, 30, 40) and picture.dtype == np.float32
    assert picture.min() == 0 and 0.1 < picture.max() <= 1
    assert not zbuffer.draw(np.zeros((0, 3), np.float32), camera).any()


def test_nearest_possible_depth_has_intensity_one():
    picture = PaperZBuffer().draw(np.array([[0, -1, 0]], np.float32), Camera(64, 64, 0.0))
    assert picture.max() == pytest.approx(1.0)
    assert (picture > 0).sum() == 25


def test_splats_are_eq1_with_three_windows_and_linear_depth():
    cloud, camera = cloud_of(300, spread=1.4), Camera(50, 44)
    middle, single, wide, depth = SplatPyramid().draw(cloud, camera)
    for channel, window in ((middle, 5), (single, 1), (wide, 13)):
        np.testing.assert_allclose(channel, eq1_by_loops(cloud, camera, window), rtol=1e-5)
    covered = middle > 0
    linear = (DEPTH_RANGE[1] - (ALPHA - BETA * np.log(middle[covered]))) / 2
    np.testing.assert_allclose(depth[covered], np.clip(linear, 0, 1), atol=1e-5)
    assert not depth[~covered].any()
