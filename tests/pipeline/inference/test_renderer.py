from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from place_cloud import place_cloud

from z2p_core.camera import Camera, turn
from z2p_core.interfaces import ScanError
from z2p_core.scene import SceneDescription
from z2p_core.shading.channels import GBufferChannel
from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_renderer.pipeline.inference.input_buffers import draw_buffers
from z2p_renderer.pipeline.inference.loading import load_network
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.models.checkpoints import WeightsError


@pytest.fixture(scope="module")
def renderer(tiny_weights: Path) -> Renderer:
    return Renderer(tiny_weights)


def axis(name: str) -> np.ndarray:
    vector = np.zeros(3)
    vector["XYZ".index(name[1])] = 1.0 if name[0] == "+" else -1.0
    return vector


@pytest.mark.parametrize("up", UP_ROTATIONS)
def test_up_axes_are_rotations_that_bring_the_axis_to_plus_z(up: str) -> None:
    rotation = np.array(UP_ROTATIONS[up], dtype=float)
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert np.isclose(np.linalg.det(rotation), 1.0)
    assert np.array_equal(rotation @ axis(up), [0, 0, 1])


@pytest.mark.parametrize(("up", "front"), [("+Z", "-Y"), ("+Y", "+Z"), ("-Y", "-Z"), ("-Z", "-Y"), ("+X", "-Y")])
def test_the_front_of_the_data_faces_the_camera(up: str, front: str) -> None:
    toward_camera = Camera(64, 64, 0.0).position / np.linalg.norm(Camera(64, 64, 0.0).position)
    assert np.allclose(np.array(UP_ROTATIONS[up]) @ axis(front), toward_camera)


def test_a_placed_cloud_fills_the_unit_sphere(cloud: np.ndarray) -> None:
    placed = place_cloud(cloud * 700, "+X", 33.0)
    assert placed.dtype == np.float32
    assert np.isclose(np.linalg.norm(placed, axis=1).max(), 1.0, atol=1e-6)
    assert np.linalg.norm(placed.max(0) + placed.min(0)) < 0.2


def test_azimuth_turns_about_the_worlds_z_after_the_up_axis(cloud: np.ndarray) -> None:
    straight, turned = place_cloud(cloud, "+Y"), place_cloud(cloud, "+Y", 90.0)
    assert np.allclose(turned, straight @ turn(90.0).T, atol=1e-6)
    assert np.allclose(turned[:, 2], straight[:, 2], atol=1e-6)
    assert not np.allclose(turned, straight, atol=0.1)


@pytest.mark.parametrize("offset", [5e6, 1e7])
def test_utm_coordinates_keep_their_digits(cloud: np.ndarray, offset: float) -> None:
    far = place_cloud(cloud + np.array([offset, offset, 0.0]), "+Z", 20.0)
    assert np.abs(far - place_cloud(cloud, "+Z", 20.0)).max() < 1e-6  # float32 would have lost 0.5


def test_one_far_outlier_does_no_harm(renderer: Renderer, cloud: np.ndarray) -> None:
    placed = place_cloud(np.vstack([cloud, [[1e12, 0, 0]]]))
    assert np.isfinite(placed).all()
    assert renderer.render(placed, width=64, height=64).shape == (64, 64, 4)


@pytest.mark.parametrize("points", [np.empty((0, 3)), np.full((5, 3), 7.0), np.array([[1e308, 0, 0], [-1e308, 0, 0]])])
def test_a_cloud_without_extent_is_refused(points: np.ndarray) -> None:
    with np.errstate(all="ignore"), pytest.raises(ScanError, match="expected points"):
        place_cloud(points)


def test_the_points_themselves_are_left_alone(cloud: np.ndarray) -> None:
    before = cloud.copy()
    place_cloud(cloud, "-Y", 10.0)
    assert np.array_equal(cloud, before)


@pytest.mark.parametrize(("width", "height"), [(64, 64), (97, 61), (33, 130)])
def test_a_picture_has_the_size_asked_for(renderer: Renderer, cloud: np.ndarray, width: int, height: int) -> None:
    picture = renderer.render(place_cloud(cloud), width=width, height=height)
    assert picture.shape == (height, width, 4)
    assert picture.dtype == np.uint8
    assert picture.std() > 0


def test_missing_values_are_the_sliders_defaults(renderer: Renderer, cloud: np.ndarray) -> None:
    placed = place_cloud(cloud)
    defaults = {name: control.slider.default for name, control in renderer.controls.items()}
    plain = renderer.render(placed, None, 64, 64)
    assert np.array_equal(plain, renderer.render(placed, defaults, 64, 64))
    for name, control in renderer.controls.items():
        assert not np.array_equal(plain, renderer.render(placed, {name: control.slider.high}, 64, 64)), name


def test_order_of_points_does_not_matter(renderer: Renderer, cloud: np.ndarray) -> None:
    placed = place_cloud(cloud)
    assert np.array_equal(renderer.render(placed, None, 64, 64), renderer.render(placed[::-1].copy(), None, 64, 64))


def test_the_picture_is_the_networks_with_straight_colour(
    renderer: Renderer, cloud: np.ndarray, tiny_weights: Path
) -> None:
    """Premultiplied again and within rounding, it is what the network gave, reconciled with the G-buffer."""
    import torch

    placed, loaded = place_cloud(cloud), load_network(tiny_weights)
    camera = Camera(64, 64, 20.0)
    scene = SceneDescription()
    for control in renderer.controls.values():
        control.apply(control.slider.default, scene)
    values = [x for control in renderer.controls.values() for x in control.encode(control.slider.default)]
    buffers = draw_buffers(placed, camera, scene, loaded.zbuffer, loaded.gbuffer)
    with torch.inference_mode():
        drawn = loaded.network(
            torch.from_numpy(buffers)[None],
            torch.from_numpy(loaded.encoder.encode(*camera.frame_coordinates(step=4))),
            torch.tensor([values], dtype=torch.float32),
        )[0].contiguous().numpy()
    loaded.gbuffer.reconcile(drawn, buffers[loaded.zbuffer.channels :], len(placed))
    expected = drawn.transpose(1, 2, 0)
    picture = renderer.render(placed, None, 64, 64).astype(np.float32) / 255
    assert np.abs(picture[..., 3] - expected[..., 3]).max() <= 0.5 / 255 + 1e-6
    lit = np.minimum(expected[..., :3], expected[..., 3:])  # colour above alpha cannot be told in straight RGBA
    assert np.abs(picture[..., :3] * picture[..., 3:] - lit).max() < 1.01 / 255


@pytest.mark.parametrize("encoder", ["none", "fourier"])
def test_weights_trained_on_crops_run_only_around_the_cloud(
    make_weights: Callable[..., Path], cloud: np.ndarray, encoder: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer = Renderer(make_weights(cropped=True, encoder=encoder), engine="torch")
    given = []
    run = renderer._engine.run
    monkeypatch.setattr(renderer._engine, "run", lambda *inputs: given.append(inputs) or run(*inputs))
    dense = np.repeat(cloud, 12, axis=0) + np.random.default_rng(2).normal(scale=0.02, size=(12 * len(cloud), 3))
    placed = (place_cloud(dense) * 0.4).astype(np.float32)
    picture = renderer.render(placed, None, 256, 192)
    (buffers, encoding, _), inputs = given[0], renderer.inputs(placed, None, 256, 192)
    height, width = buffers.shape[2:]
    assert height < 192 and width < 256 and height % 8 == 0 and width % 8 == 0
    assert encoding.shape[1:] == (height // 4, width // 4)
    whole, features = inputs[0][0], inputs[0][0, renderer._loaded.zbuffer.channels :]
    corners = [(top, left) for top in range(0, 192, 4) for left in range(0, 256, 4)
               if np.array_equal(whole[:, top : top + height, left : left + width], buffers[0])]  # fmt: skip
    ((top, left),) = corners
    outside = np.ones((192, 256), bool)
    outside[top : top + height, left : left + width] = False
    assert not features[GBufferChannel.COVERAGE][outside].any()
    assert np.array_equal(encoding, inputs[1][:, top // 4 : (top + height) // 4, left // 4 : (left + width) // 4])
    assert np.abs(picture[..., 3] / 255 - features[GBufferChannel.SHADOW])[outside].max() < 0.51 / 255
    assert (picture[..., 3][outside] > 0).any()
    renderer.render(placed[::12], None, 256, 192)
    assert given[-1][0].shape[2:] == (192, 256)  # the shadow of so few has gaps


def test_weights_without_elevation_use_their_own(make_weights: Callable[..., Path], cloud: np.ndarray) -> None:
    low = Renderer(make_weights(("color",), fixed_elevation=0.0))
    high = Renderer(make_weights(("color",), fixed_elevation=60.0))
    assert (low.fixed_elevation, high.fixed_elevation) == (0.0, 60.0)
    assert Renderer(make_weights(("color",))).fixed_elevation == SceneDescription().elevation
    placed = place_cloud(cloud)
    assert not np.array_equal(low.render(placed, None, 64, 64), high.render(placed, None, 64, 64))


def test_a_higher_floor_moves_the_shadow(renderer: Renderer, cloud: np.ndarray) -> None:
    placed = place_cloud(cloud)
    lowest = float(placed[:, 2].min())
    at_rest = renderer.render(placed, None, 64, 64)
    assert np.array_equal(at_rest, renderer.render(placed, None, 64, 64, lowest))
    assert not np.array_equal(at_rest, renderer.render(placed, None, 64, 64, lowest - 0.3))


def test_unknown_weights_name_the_shipped_ones() -> None:
    with pytest.raises(WeightsError, match="unknown weights 'nosuch'"):
        Renderer("nosuch")
