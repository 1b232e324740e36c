"""Dense clouds are drawn at the detail of their points, and as smoothly lit as sparser ones."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.camera_placement.zoomed_camera import zoomed_camera
from z2p_core.interfaces import GBuffer, PointColors
from z2p_core.placement.zoom import Zoom
from z2p_core.scene import SceneDescription
from z2p_core.shading.channels import GBufferChannel

CAMERA = Camera(192, 192)


def ball(count: int, groove_depth: float = 0.0) -> np.ndarray:
    """A sphere with narrow grooves along its meridians, too narrow for 40,000 points."""
    directions = np.random.default_rng(0).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    angle = np.arctan2(directions[:, 1], directions[:, 0])
    phase = (angle * 60 / (2 * np.pi)) % 1
    radius = 0.95 - groove_depth * np.exp(-(((phase - 0.5) / 0.12) ** 2))
    return (directions * radius[:, None]).astype(np.float32)


def drawn(cloud: np.ndarray, camera: Camera = CAMERA) -> np.ndarray:
    gbuffer: GBuffer = registry.load("gbuffers", "surfels")()
    return gbuffer.draw(cloud, camera, SceneDescription())


def contrast(features: np.ndarray) -> float:
    """Standard deviation of the radiance about its mean along short rows in the middle of the image."""
    middle = features[GBufferChannel.RADIANCE_GREY, 80:120, 72:120]
    kernel = np.ones(9) / 9
    smooth = np.stack([np.convolve(row, kernel, mode="valid") for row in middle])
    return float((middle[:, 4:-4] - smooth).std())


def test_narrow_grooves_show_in_dense_clouds() -> None:
    plain, grooved = contrast(drawn(ball(400_000))), contrast(drawn(ball(400_000, 0.01)))
    assert plain < 0.004
    assert grooved > 4 * plain


def test_zoomed_pictures_show_what_a_larger_one_does() -> None:
    whole = drawn(ball(400_000, 0.01), Camera(576, 576))[:, 192:384, 192:384]
    part = drawn(ball(400_000, 0.01), zoomed_camera(192, 192, 20.0, Zoom(3.0, (0.0, 0.0))))
    difference = (part - whole)[GBufferChannel.RADIANCE_GREY]
    assert contrast(part) == pytest.approx(contrast(whole), rel=0.1)
    assert difference.std() < 0.5 * whole[GBufferChannel.RADIANCE_GREY].std()
    assert abs(difference[whole[0] > 0.99].mean()) < 0.004


def test_light_is_that_of_the_same_sphere_with_fewer_points() -> None:
    sparse, dense = drawn(ball(39_000)), drawn(ball(160_000))
    inside = (sparse[0] > 0.99) & (dense[0] > 0.99)
    difference = (dense - sparse)[GBufferChannel.RADIANCE_GREY][inside]
    assert abs(difference.mean()) < 0.004 and difference.std() < 0.02
    assert abs(sparse[0].sum() / dense[0].sum() - 1) < 0.01


def test_the_order_of_a_dense_cloud_does_not_matter() -> None:
    cloud = ball(60_000)
    shuffled = cloud[np.random.default_rng(1).permutation(len(cloud))]
    assert np.array_equal(drawn(cloud), drawn(shuffled))


@pytest.mark.slow
@pytest.mark.parametrize("has_own_places", [False, True])
def test_colors_keep_the_detail_of_their_points(has_own_places: bool) -> None:
    cloud = ball(200_000)
    albedo = np.where((np.floor(cloud[:, 2] * 40) % 2)[:, None] > 0, [0.7, 0.6, 0.1], [0.1, 0.2, 0.6])
    places = cloud[::-1].copy() if has_own_places else cloud
    colors = PointColors(places, (albedo[::-1] if has_own_places else albedo).astype(np.float32))
    gbuffer: GBuffer = registry.load("gbuffers", "surfels")()
    out = np.empty((gbuffer.channels, 192, 192), np.float32)
    relative = gbuffer.draw_textured_into(out, cloud, colors, CAMERA, SceneDescription())
    column = relative[0, 60:130, 96] / relative[2, 60:130, 96]
    assert column.max() / column.min() > 15  # of 42: stripes are 3 pixels wide
