"""Weights and the plugins they were trained with."""

from collections.abc import Callable
from pathlib import Path

import pytest

from z2p_renderer.pipeline.inference.loading import load_network
from z2p_renderer.storage.models.checkpoints import WeightsError, load_weights, save_weights


def test_weights_of_an_older_gbuffer_can_only_be_trained_further(
    make_weights: Callable[..., Path], tmp_path: Path
) -> None:
    present = load_weights(make_weights())
    earlier = tmp_path / "earlier.safetensors"
    save_weights(earlier, present.tensors, {**present.card, "gbuffer": {"name": "surfels", "version": "0"}})
    with pytest.raises(WeightsError, match="gbuffer 'surfels' version 0"):
        load_network(earlier)
    assert load_network(earlier, to_train=True).gbuffer.version == present.card["gbuffer"]["version"]
