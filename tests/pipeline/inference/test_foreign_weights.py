"""Weights of strangers draw or are refused in one line that names the file, whatever their card and tensors say."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from z2p_core import registry
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.storage.models.checkpoints import Weights, WeightsError, load_weights


@pytest.fixture(scope="module")
def sound(make_weights) -> Weights:
    return load_weights(make_weights())


def written(folder: Path, tensors: dict[str, np.ndarray], card: object, text: str = "") -> Path:
    """A weights file whose digest is right, whatever it holds."""
    digest = hashlib.sha256(json.dumps(card, sort_keys=True).encode())
    for name in sorted(tensors):
        digest.update(f"{name} {tensors[name].dtype} {tensors[name].shape}".encode())
        digest.update(np.ascontiguousarray(tensors[name]).reshape(-1).data)
    metadata = text or json.dumps({"card": card, "sha256": digest.hexdigest()})
    save_file(tensors, folder / "stranger.safetensors", {"z2p": metadata})
    return folder / "stranger.safetensors"


def refused(path: Path) -> str:
    with pytest.raises(WeightsError) as error:
        load_plugins(path)
    assert "stranger.safetensors" in str(error.value) and "\n" not in str(error.value)
    return str(error.value)


def test_sound_weights_are_taken(sound, tmp_path):
    assert load_plugins(written(tmp_path, sound.tensors, sound.card)).settings == 7


CARDS = {
    "network": [None, [], 3, {"widths": [10**9, 10**9]}, {"widths": [True, 16]}, {"widths": "wide"}, {"mapping": -1},
                {"kind": "unet"}, {"depth": 3}, {"kind": ["unshuffle_unet"]}, {"widths": [4096] * 10}],
    "zbuffer": [None, "splats", {"name": "splats"}, {"name": 3, "version": "1"}, {"name": "nosuch", "version": "1"},
                {"name": "splats", "version": "0"}, {"name": "splats", "version": 1}],
    "gbuffer": [{"name": "", "version": "1"}],
    "encoder": [{"name": "none", "version": "1"}, {"name": "fourier", "version": "1", "state": {}},
                {"name": "fourier", "version": "1", "state": {"omega": "x"}},
                {"name": "fourier", "version": "1", "state": {"omega": [[1], [2]]}},
                {"name": "fourier", "version": "1", "state": {"omega": [1.0] * 5000}}],
    "controls": [[], {}, ["color"], [{"name": "color", "version": "1", "size": 10**9}],
                 [{"name": "color", "version": "1", "size": 3}] * 2, [{"name": "coat", "version": "1", "size": 1}]],
    "resolution": ["large", [0], [-64], [1e9], {}],
    "fixed_elevation": ["20", [20], 1000, True],
    "training": [None, [], {"cropped": "yes"}],
    "format": [2, "1", None, True, 1.0],
}  # fmt: skip


@pytest.mark.parametrize("key", CARDS)
def test_an_impossible_card_is_refused_before_it_is_used(sound, tmp_path, key, monkeypatch):
    import torch

    monkeypatch.setattr(torch, "empty", None)  # no network is built, so no tensor is made for one
    for value in CARDS[key]:
        if key == "network" and isinstance(value, dict):
            value = {**sound.card["network"], **value}
        refused(written(tmp_path, sound.tensors, {**sound.card, key: value}))
    refused(written(tmp_path, sound.tensors, {name: value for name, value in sound.card.items() if name != key}))


def test_a_missing_plugin_is_named_with_what_to_do(sound, tmp_path):
    card = {**sound.card, "gbuffer": {"name": "velvet", "version": "3"}}
    assert "install the package" in (told := refused(written(tmp_path, sound.tensors, card)))
    assert "gbuffer 'velvet', version 3" in told
    with pytest.raises(registry.PluginError):
        load_plugins(tmp_path / "stranger.safetensors")


@pytest.mark.parametrize("text", [
    "{", "[]", "3", '"card"', "NaN", '{"card": 1}', '{"card": {"a": NaN}, "sha256": ""}', "[" * 100_000,
    '{"card": {"format": ' + "9" * 5000 + "}}", '{"card": {"format": 1e999}}', '{"card": ' * 60 + "1" + "}" * 60,
])  # fmt: skip
def test_metadata_that_are_no_card_are_refused(sound, tmp_path, text):
    refused(written(tmp_path, {"a": np.ones(1, np.float32)}, {}, text))


def test_tensors_that_are_not_the_networks_are_refused(sound, tmp_path):
    name = "stem.weight"
    tensor = sound.tensors[name]
    others = {key: value for key, value in sound.tensors.items() if key != name}
    broken = tensor.copy()
    broken.reshape(-1)[0] = np.nan
    for changed in (broken, np.full_like(tensor, np.inf), tensor.astype(np.float64), tensor.astype(np.int32),
                    tensor[..., None], tensor.reshape(-1)):  # fmt: skip
        refused(written(tmp_path, {**others, name: changed}, sound.card))
    assert name in refused(written(tmp_path, others, sound.card))
    assert "more" in refused(written(tmp_path, {**sound.tensors, "more": tensor}, sound.card))
