"""The weights that z2p ships: they load, they are small, and they draw what is asked of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from place_cloud import place_cloud

from z2p_core import registry
from z2p_core.images import composite, unit_from_bytes
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.models.checkpoints import SHIPPED_FOLDER, load_weights, shipped_weights
from z2p_renderer.storage.models.onnx_deltas import INT8, graph_path, load_graph
from z2p_renderer.storage.results.fingerprints import file_digest
from z2p_renderer.storage.scans.clouds import read_clouds

SAMPLES = Path(__file__).parents[3] / "samples"


@pytest.fixture(scope="module")
def suzanne() -> np.ndarray:
    return place_cloud(read_clouds(SAMPLES / "suzanne.ply")[0].points)


@pytest.fixture(scope="module")
def regular() -> Renderer:
    return Renderer("regular")


def test_shipped_weights_fit_into_forty_megabytes() -> None:
    assert "regular" in shipped_weights()
    assert sum(path.stat().st_size for path in SHIPPED_FOLDER.iterdir()) < 40e6
    assert not list(SHIPPED_FOLDER.glob("*.onnx"))  # a graph file says the same in a few kilobytes


@pytest.mark.parametrize("name", sorted(shipped_weights()))
def test_each_has_a_card_that_names_this_very_file(name: str) -> None:
    page = (SHIPPED_FOLDER / f"{name}.md").read_text()
    assert file_digest(shipped_weights()[name]) in page
    for control in load_weights(shipped_weights()[name]).card["controls"]:
        assert control["name"] in page


@pytest.mark.parametrize("name", sorted(shipped_weights()))
def test_each_has_an_export_of_this_very_network(name: str) -> None:
    assert load_graph(shipped_weights()[name], load_weights(shipped_weights()[name]).digest) is not None


@pytest.mark.slow
@pytest.mark.parametrize("engine", registry.names("engines"))
def test_every_engine_draws_regular_as_torch_does(suzanne: np.ndarray, engine: str) -> None:
    if registry.load("engines", engine).reads_int8 and not graph_path(shipped_weights()["regular"], INT8).exists():
        pytest.skip("8 bits were not good enough for these weights")
    for side in (256, 512):
        expected = Renderer("regular", engine="torch").render(suzanne, None, side, side)
        picture = Renderer("regular", engine=engine).render(suzanne, None, side, side)
        off = np.abs(picture.astype(int) - expected)[expected[..., 3] > 229]
        exact = registry.load("engines", engine).exact
        assert np.quantile(off, 0.999) <= (2 if exact else 12) and off.mean() < (0.2 if exact else 1.5)


def test_regular_steers_colour_light_and_elevation(regular: Renderer) -> None:
    assert list(regular.controls) == ["color", "light", "elevation"]


@pytest.mark.parametrize("side", [256, 512])
def test_the_picture_shows_the_object_in_the_colour_asked_for(
    regular: Renderer, suzanne: np.ndarray, side: int
) -> None:
    light = (4.0, 0.0, 40.0)
    for color in ((0.8, 0.2, 0.2), (0.2, 0.7, 0.3), (0.25, 0.3, 0.8)):
        picture = unit_from_bytes(regular.render(suzanne, {"color": color, "light": light}, side, side))
        solid = picture[..., 3] > 0.98
        assert 0.05 < solid.mean() < 0.5  # the object, and neither all nor nothing
        median = np.median(picture[solid][:, :3], axis=0)
        assert np.argmax(median) == np.argmax(color)
        assert np.abs(median / median.max() - np.array(color) / max(color)).max() < 0.25
        assert picture[: side // 16, :, 3].max() < 0.3  # nothing hangs in the sky


def test_light_from_the_right_casts_the_shadow_to_the_left(
    regular: Renderer, suzanne: np.ndarray
) -> None:
    def balance(azimuth: float) -> tuple[float, float]:
        picture = unit_from_bytes(regular.render(suzanne, {"light": (3.6, azimuth, 40.0)}, 256, 256))
        columns = np.arange(256) - 127.5
        solid = picture[..., 3] > 0.98
        brightness = np.where(solid, composite(picture, (0, 0, 0)).mean(-1), 0)
        shadow = np.where((picture[..., 3] > 0.1) & (picture[..., 3] < 0.8), picture[..., 3], 0)
        return float((brightness * columns).sum() / brightness.sum()), float((shadow * columns).sum() / shadow.sum())

    right, left = balance(70.0), balance(-70.0)
    assert right[0] > left[0] + 3
    assert right[1] < left[1] - 10
