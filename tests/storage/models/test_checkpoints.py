"""Weights and checkpoints: safetensors with a card; damage, pickles and strangers are refused with a clear word."""

import json
import pickle
import stat
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from z2p_renderer.storage.models import checkpoints
from z2p_renderer.storage.models.checkpoints import (
    CHECKPOINT,
    PREVIOUS_CHECKPOINT,
    Weights,
    WeightsError,
    check_tensors,
    find_weights,
    load_checkpoint,
    load_weights,
    save_checkpoint,
    save_weights,
)

CARD = {
    "network": {"kind": "unshuffle_unet"},
    "zbuffer": {"name": "paper", "version": "1"},
    "gbuffer": {"name": "none", "version": "1"},
    "encoder": {"name": "none", "version": "1", "state": {}},
    "controls": [{"name": "color", "version": "1", "size": 3}],
    "resolution": 64,
    "fixed_elevation": 20.0,
    "training": {"note": "für später"},
}
TENSORS = {"a.weight": np.random.default_rng(0).normal(size=(3, 4)).astype(np.float32), "b": np.ones(2, np.float32)}


def test_weights_round_trip_whole_and_half(tmp_path):
    for half, tolerance in ((False, 0), (True, 1e-3)):
        save_weights(tmp_path / "w.safetensors", TENSORS, CARD, half=half)
        weights = load_weights(tmp_path / "w.safetensors")
        assert weights.card == {"format": 1, **CARD}
        for name, tensor in TENSORS.items():
            assert weights.tensors[name].dtype == np.float32
            np.testing.assert_allclose(weights.tensors[name], tensor, rtol=tolerance, atol=0)
    assert [path.name for path in tmp_path.iterdir()] == ["w.safetensors"]


def test_equal_weights_are_equal_bytes_and_others_may_read_them(tmp_path):
    paths = [tmp_path / name for name in ("one.safetensors", "two.safetensors")]
    for path in paths:
        save_weights(path, TENSORS, CARD)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    (tmp_path / "plain").touch()
    assert stat.S_IMODE(paths[0].stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_pickles_and_other_files_are_refused(tmp_path):
    path = tmp_path / "w.safetensors"
    for start in (pickle.dumps(TENSORS), b"PK\x03\x04" + bytes(100)):
        path.write_bytes(start)
        with pytest.raises(WeightsError, match="a pickle; expected safetensors"):
            load_weights(path)
    for content in (b"", b"hello", bytes(1000)):
        path.write_bytes(content)
        with pytest.raises(WeightsError, match="not safetensors"):
            load_weights(path)
    save_file(TENSORS, path)
    with pytest.raises(WeightsError, match="without z2p's card"):
        load_weights(path)
    with pytest.raises(WeightsError, match="no such weights"):
        load_weights(tmp_path / "absent.safetensors")


def test_damage_anywhere_is_told(tmp_path):
    path = tmp_path / "w.safetensors"
    save_weights(path, TENSORS, CARD)
    whole = path.read_bytes()
    for place in range(0, len(whole), 7):
        flipped = bytearray(whole)
        flipped[place] ^= 4
        path.write_bytes(flipped)
        with pytest.raises(WeightsError):
            load_weights(path)
    path.write_bytes(whole[:-1])
    with pytest.raises(WeightsError, match="truncated"):
        load_weights(path)


def test_card_of_another_format_or_incomplete(tmp_path, monkeypatch):
    path = tmp_path / "w.safetensors"
    with pytest.raises(WeightsError, match="lacks zbuffer"):
        save_weights(path, TENSORS, {key: value for key, value in CARD.items() if key != "zbuffer"})
    monkeypatch.setattr(checkpoints, "FORMAT", 2)
    save_weights(path, TENSORS, CARD)
    monkeypatch.undo()
    with pytest.raises(WeightsError, match="expected weights of format 1, got 2"):
        load_weights(path)


def test_values_that_do_not_fit_are_refused(tmp_path):
    for value, half in ((1e6, True), (np.nan, False)):
        with pytest.raises(WeightsError, match="not finite in float"):
            save_weights(tmp_path / "w.safetensors", {"a": np.array([value])}, CARD, half=half)
    assert not list(tmp_path.iterdir())


def test_check_names_what_does_not_fit():
    weights = Weights(TENSORS, CARD)
    check_tensors(weights, {"a.weight": (3, 4), "b": (2,)})
    with pytest.raises(WeightsError, match=r"missing \['c'\], unknown \['b'\]"):
        check_tensors(weights, {"a.weight": (3, 4), "c": (2,)})
    with pytest.raises(WeightsError, match=r"b: expected shape \(3,\), got \(2,\)"):
        check_tensors(weights, {"a.weight": (3, 4), "b": (3,)})


def test_resolve_knows_shipped_names_and_files(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoints, "SHIPPED_FOLDER", tmp_path)
    save_weights(tmp_path / "regular.safetensors", TENSORS, CARD)
    assert find_weights("regular") == tmp_path / "regular.safetensors"
    assert find_weights(str(tmp_path / "regular.safetensors")) == Path(tmp_path / "regular.safetensors")
    with pytest.raises(WeightsError, match="unknown weights 'regulr'; shipped: regular"):
        find_weights("regulr")


def test_checkpoint_keeps_two_and_falls_back(tmp_path):
    assert load_checkpoint(tmp_path) is None
    for step in (1, 2, 3):
        save_checkpoint(tmp_path, {"x": np.full(50, step, np.float64), "count": np.float32(step)}, {"step": step})
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([CHECKPOINT, PREVIOUS_CHECKPOINT])
    tensors, state, warnings = load_checkpoint(tmp_path)
    assert state == {"step": 3} and tensors["x"][0] == 3 and tensors["count"].shape == () and not warnings

    damaged = bytearray((tmp_path / CHECKPOINT).read_bytes())
    damaged[-5] ^= 1
    (tmp_path / CHECKPOINT).write_bytes(damaged)
    tensors, state, warnings = load_checkpoint(tmp_path)
    assert state == {"step": 2} and tensors["x"][0] == 2 and "damaged" in warnings[0]

    (tmp_path / CHECKPOINT).unlink()  # killed between the two renames
    assert load_checkpoint(tmp_path)[1] == {"step": 2}
    (tmp_path / PREVIOUS_CHECKPOINT).write_bytes(b"")
    assert load_checkpoint(tmp_path)[1] == {}


def test_checkpoint_floats_come_back_exactly(tmp_path):
    state = {"losses": [0.1, 1 / 3, 1e-17]}
    save_checkpoint(tmp_path, {"x": np.zeros(1)}, state)
    assert load_checkpoint(tmp_path)[1] == json.loads(json.dumps(state)) == state
