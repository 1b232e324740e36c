"""The script that makes a leaner network: what it takes away was not heard, and what is left draws the same."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from z2p_renderer.pipeline.inference.loading import load_network
from z2p_renderer.storage.models.checkpoints import load_weights, save_weights

SCRIPT = Path(__file__).parents[2] / "scripts" / "slim_weights.py"
SHAPE = {"widths": (16, 24, 24), "mapping": 16, "fine": 0, "refine": 8}


def slim(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(SCRIPT), *arguments], capture_output=True, text=True)


def drawn(file: Path, channels: slice | list[int] = slice(None)) -> torch.Tensor:
    """The picture of random buffers, of which the network reads those channels."""
    loaded = load_network(file)
    rng = np.random.default_rng(0)
    buffers = torch.from_numpy(rng.random((1, 14, 64, 64), dtype=np.float32))[:, channels]
    with torch.no_grad():
        loaded.network.train()  # unclamped: random weights draw beyond white
        return loaded.network(buffers, torch.zeros(loaded.encoder.channels, 16, 16), torch.full((1, 7), 0.3))


def alike(one: torch.Tensor, other: torch.Tensor) -> bool:
    """Whether they are the same picture but for rounding, which random weights, steep as they are, make much of."""
    return bool((one - other).abs().max() < 0.005 * other.abs().max())


def muted(tensors: dict[str, np.ndarray], widths: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Every third channel of each level, and inside each block, silent; and the z-buffer's last three channels."""
    result = {name: tensor.copy() for name, tensor in tensors.items()}
    for name, tensor in result.items():
        if name.split(".")[0] in ("encode", "decode", "bottom", "shrink", "grow") and "modulate" not in name:
            tensor[2::3] = 0
    for name in ("stem.weight", "stem.bias"):
        result[name][2 : widths[0] : 3] = 0
    result["stem.weight"][:, 16:64] = 0
    result["look.weight"][:, 5:8] = 0
    for name in [name for name in result if ".modulate." in name]:
        half = len(result[name]) // 2
        result[name][half + 2 :: 3] = 0  # nothing is added to what is silent inside a block
    return result


@pytest.mark.slow
def test_pruning_unused_channels_changes_nothing(make_weights: Callable[..., Path], tmp_path: Path) -> None:
    full, lean = tmp_path / "whole.safetensors", tmp_path / "lean.safetensors"
    weights = load_weights(make_weights(**SHAPE, zbuffer="splats"))
    save_weights(full, muted(weights.tensors, SHAPE["widths"]), weights.card)
    done = slim(str(full), str(lean), "--zbuffer", "paper", "--widths", "11,16,16")
    assert done.returncode == 0, done.stderr
    assert alike(drawn(lean, [0, *range(4, 14)]), drawn(full))
    assert load_weights(lean).card["network"]["widths"] == [11, 16, 16]


@pytest.mark.slow
@pytest.mark.parametrize("further", [("--fine", "8"), ("--coarse",)])
@pytest.mark.parametrize("encoder", ["none", "fourier"])
def test_new_final_convs_start_as_the_identity(
    make_weights: Callable[..., Path], tmp_path: Path, encoder: str, further: tuple[str, ...]
) -> None:
    full, lean = tmp_path / "whole.safetensors", tmp_path / "lean.safetensors"
    weights = load_weights(make_weights(**SHAPE, encoder=encoder, zbuffer="paper"))
    quiet = {name: tensor * (not name.startswith("touch")) for name, tensor in weights.tensors.items()}
    quiet["stem.weight"][:, 176:] = 0  # what is left of the encoding is its mean
    save_weights(full, quiet, weights.card)
    done = slim(str(full), str(lean), "--widths", "16,24,24", *further)
    assert done.returncode == 0, done.stderr
    channels = slice(0, 11)
    assert alike(drawn(lean, channels), drawn(full, channels))


@pytest.mark.slow
def test_widening_is_refused(make_weights: Callable[..., Path], tmp_path: Path) -> None:
    done = slim(str(make_weights(**SHAPE)), str(tmp_path / "lean.safetensors"), "--widths", "16,24,32")
    assert done.returncode != 0 and "expected none above what the weights have, got 32 for 24" in done.stderr
