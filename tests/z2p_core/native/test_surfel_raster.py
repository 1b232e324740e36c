"""Rasterized discs: their outline, depth, clipping, visibility and blending against plain geometry."""

import math

import numpy as np
import pytest

from z2p_core import native
from z2p_core.camera import Camera

COVERAGE_GAIN, FULL_WEIGHT, DEPTH_RANGE = 25.0, 2.0, (1.0, 6.0)
FACING = np.float32([0, 0, -1])
"""Normal of a disc that faces the camera."""


def draw_surfels(points, normals, radii, camera, features=None, blend_depth_radii=2.0, clip_planes=None,
                 coverage_gain=COVERAGE_GAIN):  # fmt: skip
    """Image (9, H, W) of discs in the camera's axes; `radii` is one number for all of them, or one for each."""
    features = np.zeros((len(points), 6), np.float32) if features is None else features
    clip_planes = no_clip_planes(len(points)) if clip_planes is None else clip_planes
    discs = native.Discs(points, normals, np.float32(np.broadcast_to(radii, len(points))), clip_planes)
    blending = native.Blending(blend_depth_radii, coverage_gain, FULL_WEIGHT)
    image = np.zeros((9, camera.height, camera.width), np.float32)
    native.rasterize_surfels(discs, features, camera, blending, DEPTH_RANGE, image)
    return image


def depth_in(image):
    near, far = DEPTH_RANGE
    return far - image[2] * (far - near)


def no_clip_planes(count):
    return np.tile(np.float32([0, 0, 0, math.inf]), (count, 4, 1))


def test_a_disc_facing_the_camera_covers_its_area_at_its_depth():
    camera = Camera(128, 128)
    drawn = draw_surfels(np.float32([[0.2, -0.1, 3.0]]), FACING[None], 0.3, camera)
    covered = drawn[0] > 0
    area = math.pi * (0.3 * camera.focal / 3) ** 2
    assert drawn[0].sum() == pytest.approx(area * (1 - 1 / COVERAGE_GAIN), rel=0.01)  # its rim is covered in part
    np.testing.assert_allclose(depth_in(drawn)[covered], 3.0, rtol=1e-5)
    assert drawn[0].max() == pytest.approx(1) and not drawn[:, ~covered].any()
    rows, columns = np.nonzero(covered)
    assert columns.mean() + 0.5 == pytest.approx(64 + 0.2 * camera.focal / 3, abs=0.2)
    assert rows.mean() + 0.5 == pytest.approx(64 - 0.1 * camera.focal / 3, abs=0.2)


def test_a_tilted_disc_has_the_depth_of_its_plane():
    camera, normal = Camera(128, 128), np.float32([0.6, 0, -0.8])
    drawn = draw_surfels(np.float32([[0, 0, 3.0]]), normal[None], 0.1, camera)
    rows, columns = np.nonzero(drawn[0] > 0.9)
    assert len(rows) > 50
    rays = np.stack([(columns + 0.5 - 64) / camera.focal, (rows + 0.5 - 64) / camera.focal, np.ones(len(rows))], 1)
    depth = depth_in(drawn)[rows, columns]
    np.testing.assert_allclose(depth * (rays @ normal), 3.0 * normal[2], rtol=1e-3)


def test_a_disc_has_hardly_any_weight_beyond_its_clip_planes():
    camera, points = Camera(128, 128), np.float32([[0, 0, 3.0]])
    whole, clip_planes = draw_surfels(points, FACING[None], 0.4, camera), no_clip_planes(1)
    clip_planes[0, 0] = 1, 0, 0, 0.1  # clips x > 0.1
    clip_planes[0, 1] = 0, -1, 0, 0.0  # clips y < 0
    drawn = draw_surfels(points, FACING[None], 0.4, camera, clip_planes=clip_planes)
    x = (np.arange(128) + 0.5 - 64) / camera.focal * 3.0
    left = (x <= 0.1) & (x[:, None] >= 0)
    np.testing.assert_array_equal(drawn[:, left], whole[:, left])
    beyond = ~left & (whole[1] > 0.2)
    assert (drawn[1, beyond] < 0.04 * whole[1, beyond]).all()  # the same depth and color
    np.testing.assert_allclose(drawn[2:, beyond], whole[2:, beyond], rtol=1e-5)


def test_clipped_parts_hide_nothing_behind_them():
    camera, points = Camera(64, 64), np.float32([[0, 0, 2.5], [0, 0, 3.0]])
    features = np.float32([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]])
    clip_planes = no_clip_planes(2)
    clip_planes[0, 0] = 1, 0, 0, -0.1  # the nearer disc is visible only left of its center
    drawn = draw_surfels(points, np.tile(FACING, (2, 1)), 0.3, camera, features, 0.5, clip_planes)
    assert drawn[4, 32, 32] > 0.96 and depth_in(drawn)[32, 32] == pytest.approx(3.0, abs=0.02)


def test_the_nearest_disc_is_visible_and_close_ones_blend():
    camera = Camera(64, 64)
    features = np.float32([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]])
    for gap, blended in ((0.05, True), (0.9, False)):
        points = np.float32([[0, 0, 3.0], [0, 0, 3.0 + gap]])
        for order in ([0, 1], [1, 0]):
            drawn = draw_surfels(points[order], np.tile(FACING, (2, 1)), 0.2, camera, features[order])
            assert (drawn[3, 32, 32] > 0, drawn[4, 32, 32] > 0) == (True, blended)
            assert drawn[3:5, 32, 32].sum() == pytest.approx(1)


def test_pixels_on_an_edge_show_both_sides_by_area():
    """A near disc before a large far one: its color's mean is its share of the area, and some pixels have both."""
    camera, points = Camera(64, 64), np.float32([[0.013, 0.007, 2.0], [0, 0, 5.0]])
    features = np.float32([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]])
    drawn = draw_surfels(points, np.tile(FACING, (2, 1)), [0.2, 4.0], camera, features, 0.5, coverage_gain=1e4)
    np.testing.assert_allclose(drawn[0], 1, atol=1e-6)
    np.testing.assert_allclose(drawn[3] + drawn[4], 1, atol=1e-5)
    assert drawn[3].sum() == pytest.approx(math.pi * (0.2 * camera.focal / 2.0) ** 2, rel=0.02)
    assert set(np.round(4 * drawn[3], 3).ravel()) == {0, 1, 2, 3, 4}
    alone = draw_surfels(points[:1], FACING[None], 0.2, camera)
    np.testing.assert_array_equal(alone[0] > 0, drawn[3] > 0)


def test_density_is_weight_over_that_of_a_full_surface():
    camera = Camera(64, 64)
    for count in (1, 2, 5):  # each disc has weight 1 at its center
        points = np.tile(np.float32([[0, 0, 3.0]]), (count, 1))
        drawn = draw_surfels(points, np.tile(FACING, (count, 1)), 0.5, camera)
        assert drawn[1, 32, 32] == pytest.approx(min(1.0, count / FULL_WEIGHT), rel=0.02)
        assert (drawn[1][drawn[0] == 0] == 0).all() and drawn[1].min() >= 0 and drawn[1].max() <= 1


def test_discs_outside_the_image_or_behind_it_are_not_drawn():
    points = np.float32([[0, 0, -3], [9, 0, 3], [0, -9, 3], [0, 0, 0]])
    assert not draw_surfels(points, np.tile(FACING, (4, 1)), 0.3, Camera(64, 64)).any()


def test_discs_are_cut_at_the_borders_of_the_image():
    """The rest is as in a larger image, although rows are evaluated in whole vectors, which end beyond the border."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 2, (400, 2)), rng.uniform(2.5, 4, 400)]).astype(np.float32)
    normals = rng.normal(size=(400, 3))
    normals[:, 2] = -np.abs(normals[:, 2]) - 0.5
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    features = rng.random((400, 6), np.float32)
    small, large = Camera(61, 61), Camera(161, 61)  # the same focal length, and the same center
    cut, whole = (draw_surfels(points, normals, 0.12, camera, features) for camera in (small, large))
    differs = np.abs(cut - whole[:, :, 50:111]).max(0) > 2e-5
    assert differs.sum() <= 9  # where a rim just touches a sample, or not
    assert (cut[0, :, [0, -1]] > 0).any() and (cut[0, [0, -1]] > 0).any()


@pytest.mark.parametrize("shape", [(8, 64, 64), (9, 64, 63), (9, 64, 64)])
def test_outputs_of_another_shape_or_dtype_are_refused(shape):
    discs = native.Discs(np.float32([[0, 0, 3]]), FACING[None], np.float32([1]), no_clip_planes(1))
    out = np.zeros(shape, np.float64 if shape == (9, 64, 64) else np.float32)
    with pytest.raises(ValueError, match=r"expected a contiguous float32 array \(9, 64, 64\)"):
        native.rasterize_surfels(
            discs, np.zeros((1, 6)), Camera(64, 64), native.Blending(1.0, 25.0, 2.0), DEPTH_RANGE, out
        )
