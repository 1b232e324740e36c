"""What OpenVINO compiled once is taken from the shelf the next time, and pictures stay the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from z2p_core import registry
from z2p_core.interfaces import TrainedNetwork
from z2p_renderer.pipeline.export import export_onnx
from z2p_renderer.pipeline.inference.loading import load_plugins

pytest.importorskip("openvino")


class Memory(dict):
    """A shelf of one process."""

    def put(self, key: str, content: bytes) -> None:
        self[key] = content


@pytest.fixture(scope="module")
def network(make_weights: Callable[..., Path]) -> TrainedNetwork:
    file = make_weights()
    loaded = load_plugins(file)
    sizes = loaded.buffer_channels, loaded.encoder.channels, loaded.settings
    return TrainedNetwork(*sizes, export_onnx(file).read_bytes(), loaded.build)


def picture(network: TrainedNetwork, side: int = 48) -> np.ndarray:
    rng = np.random.default_rng(0)
    cells = network.encoder_channels, side // 4, side // 4
    shapes = (1, network.buffer_channels, side, side), cells, (1, network.settings)
    buffers, encoding, settings = (rng.random(shape, dtype=np.float32) for shape in shapes)
    return registry.load("engines", "openvino")(network).run(buffers, encoding, settings)


def test_a_second_engine_takes_what_the_first_compiled(network, monkeypatch):
    plain, shelf = picture(network), Memory()
    kept = replace(network, shelf=shelf)
    np.testing.assert_array_equal(picture(kept), plain)
    assert len(shelf) == 1
    engine = registry.load("engines", "openvino")
    monkeypatch.setattr(engine, "_compiled_anew", lambda *args: pytest.fail("compiled again"))
    np.testing.assert_array_equal(picture(kept), plain)


def test_each_size_has_its_own(network):
    shelf = Memory()
    kept = replace(network, shelf=shelf)
    assert picture(kept).shape != picture(kept, 64).shape and len(shelf) == 2
    assert picture(kept).shape and len(shelf) == 2


def test_one_network_draws_windows_of_all_sizes(network):
    shelf = Memory()
    kept = replace(network, shelf=shelf, windows=True)
    for side in (48, 64, 48):
        np.testing.assert_allclose(picture(kept, side), picture(network, side), atol=1e-4)
    assert len(shelf) == 1


@pytest.mark.parametrize("damage", [lambda kept: b"", lambda kept: b"nonsense", lambda kept: kept[: len(kept) // 2]])
def test_what_cannot_be_read_is_compiled_again(network, damage):
    shelf = Memory()
    kept = replace(network, shelf=shelf)
    expected = picture(kept)
    (key,) = shelf
    shelf[key] = damage(shelf[key])
    np.testing.assert_array_equal(picture(kept), expected)
