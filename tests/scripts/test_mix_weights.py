"""The script that mixes two sets of weights: each number lies between both, and only what belongs together is mixed."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from z2p_renderer.storage.models.checkpoints import find_weights, load_weights, save_weights

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import mix_weights


@pytest.fixture
def after(tmp_path: Path) -> Path:
    """The shipped weights, as a round of training might have moved them."""
    weights = load_weights(find_weights("regular"))
    tensors = {name: tensor + np.float32(0.5) for name, tensor in weights.tensors.items()}
    save_weights(tmp_path / "after.safetensors", tensors, weights.card)
    return tmp_path / "after.safetensors"


def test_mixed_weights_are_the_weighted_mean(after: Path, tmp_path: Path) -> None:
    mix_weights.mix("regular", str(after), tmp_path / "mixed.safetensors", 0.25)
    before, mixed = load_weights(find_weights("regular")), load_weights(tmp_path / "mixed.safetensors")
    assert mixed.card == before.card
    for name, tensor in mixed.tensors.items():
        np.testing.assert_allclose(tensor, before.tensors[name] + 0.125, atol=1e-5)


def test_mixing_refuses_other_networks_and_bad_shares(after: Path, tmp_path: Path) -> None:
    out = tmp_path / "mixed.safetensors"
    with pytest.raises(ValueError, match="expected weights of the same network"):
        mix_weights.mix("material", str(after), out, 0.5)
    with pytest.raises(ValueError, match=r"expected a share from 0 to 1, got 1\.5"):
        mix_weights.mix("regular", str(after), out, 1.5)
    assert not out.exists()
