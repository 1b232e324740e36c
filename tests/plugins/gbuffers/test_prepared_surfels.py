"""A prepared cloud is drawn as a plain one, from every side, in every light, in any order."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from z2p_core.camera import Camera, turn
from z2p_core.interfaces import GBuffer, PointColors
from z2p_core.scene import SceneDescription
from z2p_core.shading.channels import RADIANCE_RGB, GBufferChannel
from z2p_renderer.plugins.gbuffers.glossy import Glossy
from z2p_renderer.plugins.gbuffers.surfels import Surfels

CAMERA = Camera(96, 96, 30.0)
SCENE = SceneDescription(material={"Base Color": (0.5, 0.25, 0.0, 1.0)})
GREEN = replace(SCENE, material={"Base Color": (0.1, 0.6, 0.1, 1.0)})
SIDELIT = replace(SCENE, light=(3.2, 70.0, 40.0))


def bumpy_cloud(count: int = 2000) -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return (points * (0.6 + 0.15 * np.sin(4 * points[:, :1])) * (1.2, 0.8, 0.6)).astype(np.float32)


def turned(cloud: np.ndarray, azimuth: float) -> np.ndarray:
    return cloud @ turn(azimuth).astype(np.float32).T


def prepared_image(prepared, azimuth: float, scene: SceneDescription, channels: int = 10) -> np.ndarray:
    image = np.full((channels, CAMERA.height, CAMERA.width), np.nan, np.float32)
    prepared.draw_into(image, azimuth, CAMERA, scene)
    return image


@pytest.mark.parametrize("gbuffer", [Surfels(), Glossy()], ids=lambda gbuffer: gbuffer.name)
def test_an_unturned_cloud_has_the_same_image_in_every_light_and_color(gbuffer: GBuffer) -> None:
    cloud = bumpy_cloud()
    prepared = gbuffer.prepare(cloud)
    for scene in (SCENE, GREEN, SIDELIT, replace(SCENE, floor=-0.9), SCENE):
        assert np.allclose(prepared_image(prepared, 0.0, scene), gbuffer.draw(cloud, CAMERA, scene), atol=1e-5)


@pytest.mark.parametrize("azimuth", [37.0, 200.0])
@pytest.mark.parametrize("scene", [SCENE, SIDELIT], ids=["default light", "light from the side"])
def test_a_turned_cloud_has_the_image_of_its_turned_points(azimuth: float, scene: SceneDescription) -> None:
    cloud = bumpy_cloud()
    image = prepared_image(Surfels().prepare(cloud), azimuth, scene)
    plain = Surfels().draw(turned(cloud, azimuth), CAMERA, scene)
    for channels in (GBufferChannel.COVERAGE, GBufferChannel.DEPTH, RADIANCE_RGB, GBufferChannel.SHADOW):
        assert np.quantile(np.abs(image[channels] - plain[channels]), 0.99) < 0.03
        assert np.abs(image[channels] - plain[channels]).mean() < 0.004


def test_colors_of_points_turn_with_the_cloud() -> None:
    cloud = bumpy_cloud()
    colors = PointColors(cloud, np.where(cloud[:, :1] > 0, (0.8, 0.1, 0.1), (0.1, 0.1, 0.8)).astype(np.float32))
    grey = replace(SCENE, material={"Base Color": (0.35, 0.35, 0.35, 1.0)})  # relative radiance divides by it
    image, plain = (np.empty((10, 96, 96), np.float32) for _ in range(2))
    relative = Surfels().prepare(cloud, colors).draw_into(image, 90.0, CAMERA, grey)
    moved = replace(colors, points=turned(cloud, 90.0))
    expected = Surfels().draw_textured_into(plain, turned(cloud, 90.0), moved, CAMERA, grey)
    assert np.abs(relative - expected).mean() < 0.01


def test_a_recolored_cloud_has_the_image_of_one_prepared_in_these_colors() -> None:
    cloud = bumpy_cloud(500)
    colors = PointColors(cloud, np.full((500, 3), 0.6, np.float32))
    plain, colored = Surfels().prepare(cloud), Surfels().prepare(cloud, colors)
    assert np.array_equal(prepared_image(plain.recolored(colors), 30.0, SCENE), prepared_image(colored, 30.0, SCENE))
    assert np.array_equal(prepared_image(colored.recolored(None), 30.0, SCENE), prepared_image(plain, 30.0, SCENE))


def test_the_order_of_images_does_not_matter() -> None:
    frames = [(0.0, SCENE), (90.0, SIDELIT), (90.0, SCENE), (0.0, replace(GREEN, floor=-1.0)), (200.0, GREEN)]
    prepared = Surfels().prepare(bumpy_cloud())
    forward = [prepared_image(prepared, *frame) for frame in frames]
    backward = [prepared_image(prepared, *frame) for frame in frames[::-1]][::-1]
    assert all(np.array_equal(*pair) for pair in zip(forward, backward, strict=True))


def test_a_light_that_turns_with_the_cloud_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from z2p_renderer.plugins.gbuffers import _prepared_surfels

    lights = []
    plain = _prepared_surfels.bounce_light
    monkeypatch.setattr(_prepared_surfels, "bounce_light", lambda *args: lights.append(1) or plain(*args))
    prepared = Surfels().prepare(bumpy_cloud(500))
    for azimuth in (0.0, 40.0, 333.3):
        prepared_image(prepared, azimuth, replace(SCENE, light=(3.6, -40.0 + azimuth, 50.0)))
    assert len(lights) == 1


@pytest.mark.parametrize("cloud", [np.empty((0, 3)), np.zeros((1, 3)), np.outer(np.linspace(-1, 1, 50), (1, 0, 0))],
                         ids=["none", "one", "a line"])  # fmt: skip
def test_clouds_without_a_surface_are_drawn_too(cloud: np.ndarray) -> None:
    cloud = cloud.astype(np.float32)
    image = prepared_image(Surfels().prepare(cloud), 30.0, SCENE)
    assert np.array_equal(image, Surfels().draw(turned(cloud, 30.0), CAMERA, SCENE))


def test_memory_is_released_with_the_prepared_cloud() -> None:
    prepared = Surfels().prepare(bumpy_cloud(500))
    prepared_image(prepared, 0.0, SCENE)
    kept = weakref.ref(prepared._light.field.direct)
    del prepared
    gc.collect()
    assert kept() is None
