"""Fits the network that scores up axes by shape features, and writes z2p_core/up_axis/feature_weights.py.

    python scripts/fit_up_axis.py MESHES [--each 250] [--hidden 16] [--seed 1]

MESHES is a folder of meshes, of which those count whose upright `upright_clouds.STANDING` tells; made things are added.
benchmarks/up_axis.py measures the outcome, on others.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np
import torch
from upright_clouds import made, meshes, shapeless

from z2p_core.up_axis.shape_features import FEATURE_NAMES, axis_features

OUT = Path(__file__).parents[1] / "z2p_core" / "up_axis" / "feature_weights.py"
UP = 4
"""Place of +Z among the axes."""
ROUNDS, DECAY = 800, 0.3
SHAPELESS = 8
"""Kinds of things for which all clouds without an upright count."""
STRETCH = 1.25
"""Factor by which each axis of a mesh is stretched or squeezed at most, so that few meshes are not learnt by heart."""
TEXT = '''"""Weights of the small network that scores up axes by their shape features; written by scripts/fit_up_axis.py."""

from __future__ import annotations

import numpy as np

FEATURE_MEAN = np.array({mean})
"""Mean (F,) of each feature over the training clouds."""
FEATURE_STD = np.array({std})
"""Standard deviation (F,) of each feature."""
HIDDEN_WEIGHTS = np.array({hidden})
"""Weights (H, F) from standardized features to hidden units."""
HIDDEN_BIAS = np.array({bias})
OUTPUT_WEIGHTS = np.array({output})
"""Weights (H,) from hidden units to the score."""


def up_axis_scores(features: np.ndarray) -> np.ndarray:
    """Logits (6,) of the probabilities that axes with these features (6, F) are up: a softmax turns them into these."""
    hidden = np.tanh((features - FEATURE_MEAN) / FEATURE_STD @ HIDDEN_WEIGHTS.T + HIDDEN_BIAS)
    scores: np.ndarray = hidden @ OUTPUT_WEIGHTS
    return scores
'''


def main() -> None:
    """Make the clouds, fit, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("--each", type=int, default=250, help="clouds of each kind of made things; half of each mesh")
    parser.add_argument("--hidden", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    standing = made(asked.seed, asked.each) + meshes(asked.meshes, asked.each // 2, asked.seed, STRETCH)
    others = shapeless(asked.seed, asked.each // 2)
    count = Counter(cloud.name for cloud in standing)
    weight = np.array([1 / count[cloud.name] for cloud in standing] + [SHAPELESS / len(others)] * len(others))
    wanted = np.full((len(weight), 6), 1 / 6)
    wanted[: len(standing)] = np.eye(6)[UP]
    table = np.array([axis_features(cloud.points) for cloud in standing + others])
    OUT.write_text(fitted(table, wanted, weight, asked.hidden, asked.seed))


def fitted(table: np.ndarray, wanted: np.ndarray, weight: np.ndarray, hidden: int, seed: int) -> str:
    """The module's text, of marks (N, 6, M), how likely each axis should be (N, 6) and what a cloud counts (N,)."""
    torch.manual_seed(seed)
    middle, spread = table.reshape(-1, len(FEATURE_NAMES)).mean(0), table.reshape(-1, len(FEATURE_NAMES)).std(0) + 1e-9
    given = torch.tensor((table - middle) / spread, dtype=torch.float32)
    goal = torch.tensor(wanted, dtype=torch.float32)
    counts = torch.tensor(weight / weight.mean(), dtype=torch.float32)
    network = torch.nn.Sequential(torch.nn.Linear(len(FEATURE_NAMES), hidden), torch.nn.Tanh(), torch.nn.Linear(hidden, 1))
    optimizer = torch.optim.AdamW(network.parameters(), lr=0.01, weight_decay=DECAY)
    for _ in range(ROUNDS):
        optimizer.zero_grad()
        off = torch.nn.functional.cross_entropy(network(given)[..., 0], goal, reduction="none")
        loss = (counts * off).mean()
        loss.backward()
        optimizer.step()
    print(f"{len(table)} clouds, loss {loss.item():.3f}")
    first, bias, last = (part.detach().numpy() for part in list(network.parameters())[:3])
    return TEXT.format(mean=_listed(middle), std=_listed(spread), hidden=_listed(first), bias=_listed(bias),
                       output=_listed(last[0]))  # fmt: skip


def _listed(numbers: np.ndarray) -> str:
    """Numbers as Python writes them, three digits each, a row or two a line."""
    if numbers.ndim == 2:
        return "[\n" + "".join(f"    {_listed(row)},\n" for row in numbers) + "]"
    words = [f"{number:.3g}" for number in numbers]
    lines = [", ".join(words[start : start + 12]) for start in range(0, len(words), 12)]
    return "[" + ",\n     ".join(lines) + "]"


if __name__ == "__main__":
    main()
