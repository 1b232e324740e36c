"""Fits the network that scores up axes by shape features, and writes z2p_core/up_axis/feature_weights.py.

    python scripts/fit_up_axis.py MESHES [--each 250] [--hidden 16] [--seed 1]

MESHES is a folder of meshes; those with a label in `upright_clouds.STANDING` are used, and synthetic objects are added.
benchmarks/up_axis.py measures the hit rate on other clouds.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np
import torch
from upright_clouds import mesh_clouds, synthetic_clouds, unoriented_clouds

from z2p_core.up_axis.shape_features import FEATURE_NAMES, axis_features

WEIGHTS_FILE = Path(__file__).parents[1] / "z2p_core" / "up_axis" / "feature_weights.py"
UP_INDEX = 4
"""Index of +Z among the axes."""
STEP_COUNT = 800
WEIGHT_DECAY = 0.3
UNORIENTED_WEIGHT = 8
"""Weight in the loss of all clouds without an up axis together; all clouds of one kind of object have a weight of 1."""
MAX_STRETCH = 1.25
"""Largest factor by which each axis of a mesh is stretched or squeezed, against overfitting to few meshes."""
MODULE_TEMPLATE = '''\
"""Weights of the small network that scores up axes by their shape features; written by scripts/fit_up_axis.py."""

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
    """Makes the clouds, fits the network and writes its weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("--each", type=int, default=250, help="clouds of each kind of object; half as many of a mesh")
    parser.add_argument("--hidden", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    oriented = synthetic_clouds(options.seed, options.each)
    oriented += mesh_clouds(options.meshes, options.each // 2, options.seed, MAX_STRETCH)
    others = unoriented_clouds(options.seed, options.each // 2)
    count = Counter(cloud.name for cloud in oriented)
    weight = np.array([1 / count[cloud.name] for cloud in oriented] + [UNORIENTED_WEIGHT / len(others)] * len(others))
    target = np.full((len(weight), 6), 1 / 6)
    target[: len(oriented)] = np.eye(6)[UP_INDEX]
    features = np.array([axis_features(cloud.points) for cloud in oriented + others])
    WEIGHTS_FILE.write_text(fit_network(features, target, weight, options.hidden, options.seed))


def fit_network(features: np.ndarray, target: np.ndarray, weight: np.ndarray, hidden: int, seed: int) -> str:
    """The module's text, for features (N, 6, F), target probabilities of the axes (N, 6) and weights of clouds (N,)."""
    torch.manual_seed(seed)
    count = len(FEATURE_NAMES)
    mean, std = features.reshape(-1, count).mean(0), features.reshape(-1, count).std(0) + 1e-9
    inputs = torch.tensor((features - mean) / std, dtype=torch.float32)
    targets = torch.tensor(target, dtype=torch.float32)
    weights = torch.tensor(weight / weight.mean(), dtype=torch.float32)
    network = torch.nn.Sequential(torch.nn.Linear(count, hidden), torch.nn.Tanh(), torch.nn.Linear(hidden, 1))
    optimizer = torch.optim.AdamW(network.parameters(), lr=0.01, weight_decay=WEIGHT_DECAY)
    for _ in range(STEP_COUNT):
        optimizer.zero_grad()
        errors = torch.nn.functional.cross_entropy(network(inputs)[..., 0], targets, reduction="none")
        loss = (weights * errors).mean()
        loss.backward()
        optimizer.step()
    print(f"{len(features)} clouds, loss {loss.item():.3f}")
    first, bias, last = (part.detach().numpy() for part in list(network.parameters())[:3])
    return MODULE_TEMPLATE.format(mean=_to_source(mean), std=_to_source(std), hidden=_to_source(first),
                                  bias=_to_source(bias), output=_to_source(last[0]))  # fmt: skip


def _to_source(numbers: np.ndarray) -> str:
    """A vector or matrix as a Python list, with three digits and at most twelve numbers in a line."""
    if numbers.ndim == 2:
        return "[\n" + "".join(f"    {_to_source(row)},\n" for row in numbers) + "]"
    words = [f"{number:.3g}" for number in numbers]
    lines = [", ".join(words[start : start + 12]) for start in range(0, len(words), 12)]
    return "[" + ",\n     ".join(lines) + "]"


if __name__ == "__main__":
    main()
