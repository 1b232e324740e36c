"""Trains the graph network that refines normals (`normal_gnn.c`), and writes its weights as a C header.

    python scripts/train_normal_gnn.py MESHES [MESHES ...] [--steps 5000] [--begin HEADER] [--output HEADER]
    python scripts/train_normal_gnn.py MESHES --begin HEADER --steps 0 --measure OTHERS

Clouds are sampled from meshes as scanners and samplers do (`scan_simulation.py`). The network's input is the local fit
of `z2p_core/surface/normals.py`; its targets are the meshes' normals, and the points before noise was added. HEADER is
`z2p_core/native/c/points/normal_gnn_weights.h` by default. A network that continues from a header may be larger
(`--rounds`, `--width`). With a CUDA card, use more clouds a step (`--groups`) and as many `--workers` as cores.
Afterwards install z2p again, which compiles the header, and train the renderer's weights further, which know
only the previous normals.
"""

from __future__ import annotations

import argparse
import math
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import torch
from normal_network import CloudBatch, NormalNetwork, grow_network, merge_clouds, read_header, write_header
from scan_simulation import Shape, read_shape, sample_scan, sample_shape
from torch import nn
from torch.utils.data import DataLoader, IterableDataset, get_worker_info
from tqdm import tqdm

from z2p_core.parallel import without_second_core
from z2p_core.surface.normals import fit_local_patches
from z2p_renderer.storage.meshes import find_meshes

HEADER = Path(__file__).resolve().parents[1] / "z2p_core/native/c/points/normal_gnn_weights.h"
ROUNDS = 3
"""Rounds of a new network; `normal_gnn.c` is compiled for the number in the header."""
WIDTH = 16
"""Hidden units of a new network, likewise."""
CLOUDS_PER_GROUP = 2
"""Clouds in a group, which is one batch of the network."""
GROUPS_PER_SORT = 8
"""Groups that are sampled at a time and sorted by number of neighbors, so that a group needs little padding."""
REPLAY_GROUPS = 512
"""Groups that are kept for reuse in later steps."""
MAX_LEARNING_RATE = 4e-3
"""Peak learning rate; a cosine schedule ends near 0."""
WARMUP_STEPS = 100
"""Steps until the peak is reached."""
MEASURED_CASES = ((2048, 0.0), (5000, 0.0), (5000, 0.01), (5000, 0.02), (20_000, 0.01))
"""Points, and noise in the radius of the shape."""
EARLY_ROUND_WEIGHT = 0.3
"""Weight in the loss of every round before the last."""
OFFSET_WEIGHT = 0.3
"""Weight in the loss of distances off the surface, in spacings, against the sine of the angle between normals."""


def main() -> None:
    """Trains the network and writes the header."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", type=Path, help="folders of meshes to train with")
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--rate", type=float, default=MAX_LEARNING_RATE, help="peak learning rate")
    parser.add_argument("--groups", type=int, default=1, help=f"groups of {CLOUDS_PER_GROUP} clouds in a step")
    parser.add_argument("--fresh", type=int, help="new groups in a step, the others are reused; all by default")
    parser.add_argument("--workers", type=int, default=0, help="processes that sample clouds")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--begin", type=Path, help="a header to continue from")
    parser.add_argument("--rounds", type=int, help=f"rounds; by default those of --begin, or {ROUNDS}")
    parser.add_argument("--width", type=int, help=f"hidden units; by default those of --begin, or {WIDTH}")
    parser.add_argument("--output", type=Path, default=HEADER)
    parser.add_argument("--measure", type=Path, help="a folder of other meshes to measure the error on")
    options = parser.parse_args()
    if options.width is not None and (options.width < WIDTH or options.width & (options.width - 1)):
        parser.error(
            f"--width: expected a power of two, {WIDTH} or more, as normal_gnn.c computes with; got {options.width}"
        )
    torch.manual_seed(options.seed)
    if options.begin:
        before = read_header(options.begin)
        network = grow_network(before, options.rounds or len(before.rounds), options.width or before.width)
    else:
        network = NormalNetwork(options.rounds or ROUNDS, options.width or WIDTH)
    network.to(torch.device("cuda" if torch.cuda.is_available() else "cpu"))
    if options.steps:
        shapes = [read_shape(path) for folder in options.meshes for path in find_meshes(folder).values()]
        loader = DataLoader(Groups(shapes, options.seed), batch_size=None, num_workers=options.workers)
        train(network, loader, options.steps, options.rate, options.groups, options.fresh or options.groups)
        write_header(options.output, network.cpu())
        network = read_header(options.output)  # with the rounded weights that are compiled
    if options.measure:
        for line in measure_angles(network, [read_shape(path) for path in find_meshes(options.measure).values()]):
            print(line)


class Groups(IterableDataset[CloudBatch]):
    """Endless groups of clouds of the shapes; clouds in a group have similar numbers of neighbors."""

    def __init__(self, shapes: Sequence[Shape], seed: int) -> None:
        super().__init__()
        self.shapes, self.seed = shapes, seed

    def __iter__(self) -> Iterator[CloudBatch]:
        worker = get_worker_info()
        rng = np.random.default_rng([self.seed, worker.id if worker else 0])
        while True:
            scans = (
                sample_scan(self.shapes[rng.integers(len(self.shapes))], rng)
                for _ in range(CLOUDS_PER_GROUP * GROUPS_PER_SORT)
            )
            with without_second_core() if worker else nullcontext():
                clouds = sorted((make_batch(*scan) for scan in scans), key=lambda cloud: cloud.neighbors.shape[1])
            for number in rng.permutation(GROUPS_PER_SORT):
                yield merge_clouds(clouds[CLOUDS_PER_GROUP * number : CLOUDS_PER_GROUP * (number + 1)])


def train(
    network: NormalNetwork, loader: DataLoader[CloudBatch], steps: int, max_rate: float, groups: int, fresh: int
) -> None:
    """Trains the network with this many groups a step, of which `fresh` are new and the others are reused."""
    optimizer = torch.optim.Adam(network.parameters())
    device, rng = next(network.parameters()).device, np.random.default_rng(0)
    kept: deque[CloudBatch] = deque(maxlen=max(REPLAY_GROUPS, groups))
    batches = iter(loader)
    for step in (bar := tqdm(range(steps))):
        while len(kept) < groups - fresh:
            kept.append(next(batches).to(device))
        reused = [kept[number] for number in rng.choice(len(kept), groups - fresh, replace=False)]
        kept.extend(new := [next(batches).to(device) for _ in range(fresh)])
        loss = training_step(network, optimizer, new + reused, learning_rate(step, steps, max_rate))
        if step % 100 == 0:
            bar.set_postfix(loss=f"{loss:.3f}")


def learning_rate(step: int, steps: int, max_rate: float) -> float:
    """Linear warmup, then a cosine schedule."""
    return max_rate * min(1.0, (step + 1) / WARMUP_STEPS) * (0.5 + 0.5 * math.cos(math.pi * step / steps))


def training_step(
    network: NormalNetwork, optimizer: torch.optim.Optimizer, groups: Sequence[CloudBatch], rate: float
) -> float:
    """One step of the optimizer on all groups; returns the loss of the last one."""
    for group in optimizer.param_groups:
        group["lr"] = rate
    optimizer.zero_grad()
    for clouds in groups:
        loss = compute_loss(network, clouds)
        (loss / len(groups)).backward()
    nn.utils.clip_grad_norm_(network.parameters(), 0.5)
    optimizer.step()
    return loss.item()


def compute_loss(network: NormalNetwork, clouds: CloudBatch) -> torch.Tensor:
    """Mean sine of the angle to the true normal, of either sign, plus the weighted distance from the surface."""
    total = clouds.weight.new_zeros(())
    for number, (points, normals) in enumerate(network(clouds), 1):
        cosine = (normals * clouds.true_normals).sum(-1)
        sine = torch.sqrt((1 - cosine**2).clamp(min=0) + 1e-4)
        distance = ((points - clouds.true_points) * clouds.true_normals).sum(-1).abs() / clouds.spacing
        total = (
            total
            + (1.0 if number == len(network.rounds) else EARLY_ROUND_WEIGHT)
            * (clouds.weight * (sine + OFFSET_WEIGHT * distance)).sum()
        )
    return total


def measure_angles(network: NormalNetwork, shapes: Sequence[Shape]) -> Iterator[str]:
    """Lines with mean angles to the true normals, in degrees: of the local fits, and of the network."""
    device = next(network.parameters()).device
    for count, noise in MEASURED_CASES:
        angles = []
        for shape in shapes:
            rng = np.random.default_rng(3)
            points, normals = sample_shape(shape, count, rng)
            noisy = (points + noise * rng.normal(size=points.shape)).astype(np.float32)
            cloud = make_batch(points, normals, noisy).to(device)
            with torch.no_grad():
                *_, (_, refined) = network(cloud)
            estimates = (cloud.normals, refined)
            cosines = [(estimate * cloud.true_normals).sum(-1).abs().clamp(max=1) for estimate in estimates]
            angles.append([float(torch.rad2deg(torch.arccos(cosine)).mean()) for cosine in cosines])
        local, network_angle = np.mean(angles, axis=0)
        yield f"{count} points, noise {noise:g}: {local:.2f} degrees before, {network_angle:.2f} after the network"


def make_batch(true_points: np.ndarray, true_normals: np.ndarray, cloud: np.ndarray) -> CloudBatch:
    """The network's input and targets for a cloud (N, 3) with noise; the true points and normals have none."""
    fit, count = fit_local_patches(cloud), len(cloud)
    order = np.empty(count, np.int64)
    order[np.lexsort(fit.grid.points.T)] = np.lexsort(cloud.T)  # the grid has sorted them
    points, normals, scale, neighbors, true_points, true_normals = (
        torch.from_numpy(np.ascontiguousarray(array))
        for array in (fit.grid.points, fit.normals, fit.scale, fit.neighbors,
                      true_points[order].astype(np.float32), true_normals[order].astype(np.float32))
    )  # fmt: skip
    return CloudBatch(
        points, normals, scale, torch.full((count,), fit.noise / fit.median_spacing), neighbors,
        torch.full(neighbors.shape, 1 / neighbors.shape[1]), true_points, true_normals,
        torch.full((count,), fit.median_spacing),
        torch.full((count,), 1 / count),
    )  # fmt: skip


if __name__ == "__main__":
    main()
