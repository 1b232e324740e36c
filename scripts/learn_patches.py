"""Teaches the small network that lets neighbouring points agree upon their patches, and writes it as C.

    python scripts/learn_patches.py MESHES [MESHES ...] [--steps 5000] [--begin HEADER] [--output HEADER]
    python scripts/learn_patches.py MESHES --begin HEADER --steps 0 --measure OTHERS

Clouds are drawn from the meshes as scanners and samplers draw them (`scanned_clouds.py`). What `z2p_core/surface/normals.py`
finds without the network is what it begins with; the meshes' own normals, and where the points lay before the noise,
are what it should find. HEADER is `z2p_core/native/c/points/normal_gnn_weights.h` unless another is named. A network that goes on
from a header may be larger (`--rounds`, `--width`). With a CUDA card, take more clouds a step (`--groups`) and as many
`--workers` as there are cores. Install z2p again to compile it, and train the weights some more, which have learnt from
patches as they were.
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
from patch_network import Patches, Refinement, grown, read_header, together, write_header
from scanned_clouds import Shape, drawn, on_shape, shape_of
from torch import nn
from torch.utils.data import DataLoader, IterableDataset, get_worker_info
from tqdm import tqdm

from z2p_core.parallel import without_second_core
from z2p_core.surface.normals import fit_local_patches
from z2p_renderer.storage.meshes import find_meshes

HEADER = Path(__file__).resolve().parents[1] / "z2p_core/native/c/points/normal_gnn_weights.h"
ROUNDS, WIDTH = 3, 16
"""Of a network from nothing. `refine.c` is compiled for the size that the header says."""
GROUP, SORTED = 2, 8
"""Clouds of a group; so many groups are drawn together, and sorted by how many neighbours their clouds ask for."""
KEPT = 512
"""Groups that are kept to be learnt from again."""
RATE, WARM = 4e-3, 100
"""Rate of learning at most, and steps until it is reached; it ends near 0."""
MEASURED = ((2048, 0.0), (5000, 0.0), (5000, 0.01), (5000, 0.02), (20_000, 0.01))
"""Points, and noise in the radius of the shape."""
EARLY, OFF = 0.3, 0.3
"""Weights in the loss: of what rounds before the last say, and of points off their surface, in spacings, against the
sine of the angle between normals."""


def main() -> None:
    """Learn, and write the header."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", type=Path, help="folders of meshes to learn from")
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--rate", type=float, default=RATE, help="of learning, at most")
    parser.add_argument("--groups", type=int, default=1, help=f"of {GROUP} clouds each that a step learns from")
    parser.add_argument("--fresh", type=int, help="groups a step that were not learnt from before; all without it")
    parser.add_argument("--workers", type=int, default=0, help="processes that draw clouds")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--begin", type=Path, help="a header to go on from")
    parser.add_argument("--rounds", type=int, help=f"{ROUNDS}, or as many as --begin has, without it")
    parser.add_argument("--width", type=int, help=f"units; {WIDTH}, or as many as --begin has, without it")
    parser.add_argument("--output", type=Path, default=HEADER)
    parser.add_argument("--measure", type=Path, help="a folder of other meshes, to measure it on")
    asked = parser.parse_args()
    if asked.width is not None and (asked.width < WIDTH or asked.width & (asked.width - 1)):
        parser.error(f"--width: expected a power of two, {WIDTH} or more, as refine.c computes with; got {asked.width}")
    torch.manual_seed(asked.seed)
    if asked.begin:
        before = read_header(asked.begin)
        network = grown(before, asked.rounds or len(before.rounds), asked.width or before.width)
    else:
        network = Refinement(asked.rounds or ROUNDS, asked.width or WIDTH)
    network.to(torch.device("cuda" if torch.cuda.is_available() else "cpu"))
    if asked.steps:
        shapes = [shape_of(path) for folder in asked.meshes for path in find_meshes(folder).values()]
        loader = DataLoader(Groups(shapes, asked.seed), batch_size=None, num_workers=asked.workers)
        learn(network, loader, asked.steps, asked.rate, asked.groups, asked.fresh or asked.groups)
        write_header(asked.output, network.cpu())
        network = read_header(asked.output)  # as rounded as it will be used
    if asked.measure:
        for line in measured(network, [shape_of(path) for path in find_meshes(asked.measure).values()]):
            print(line)


class Groups(IterableDataset[Patches]):
    """Endless groups of clouds of the shapes. Those of one group ask for about as many neighbours."""

    def __init__(self, shapes: Sequence[Shape], seed: int) -> None:
        super().__init__()
        self.shapes, self.seed = shapes, seed

    def __iter__(self) -> Iterator[Patches]:
        worker = get_worker_info()
        rng = np.random.default_rng([self.seed, worker.id if worker else 0])
        while True:
            drawings = (drawn(self.shapes[rng.integers(len(self.shapes))], rng) for _ in range(GROUP * SORTED))
            with without_second_core() if worker else nullcontext():
                clouds = sorted((patches_of(*each) for each in drawings), key=lambda cloud: cloud.found.shape[1])
            for number in rng.permutation(SORTED):
                yield together(clouds[GROUP * number : GROUP * (number + 1)])


def learn(
    network: Refinement, loader: DataLoader[Patches], steps: int, highest: float, groups: int, fresh: int
) -> None:
    """Teaches the network with so many groups a step, `fresh` of them new; the others were learnt from before."""
    optimizer = torch.optim.Adam(network.parameters())
    device, rng = next(network.parameters()).device, np.random.default_rng(0)
    kept: deque[Patches] = deque(maxlen=max(KEPT, groups))
    coming = iter(loader)
    for step in (bar := tqdm(range(steps))):
        while len(kept) < groups - fresh:
            kept.append(next(coming).to(device))
        again = [kept[number] for number in rng.choice(len(kept), groups - fresh, replace=False)]
        kept.extend(new := [next(coming).to(device) for _ in range(fresh)])
        loss = learn_step(network, optimizer, new + again, rate_at(step, steps, highest))
        if step % 100 == 0:
            bar.set_postfix(loss=f"{loss:.3f}")


def rate_at(step: int, steps: int, highest: float) -> float:
    """The rate of learning at a step of so many."""
    return highest * min(1.0, (step + 1) / WARM) * (0.5 + 0.5 * math.cos(math.pi * step / steps))


def learn_step(network: Refinement, optimizer: torch.optim.Optimizer, groups: Sequence[Patches], rate: float) -> float:
    """One step of the optimizer on all groups; the loss of the last one."""
    for group in optimizer.param_groups:
        group["lr"] = rate
    optimizer.zero_grad()
    for clouds in groups:
        loss = loss_of(network, clouds)
        (loss / len(groups)).backward()
    nn.utils.clip_grad_norm_(network.parameters(), 0.5)
    optimizer.step()
    return loss.item()


def loss_of(network: Refinement, clouds: Patches) -> torch.Tensor:
    """Sines of the angles to the true normals, of either sign, and distances from the surface; means."""
    total = clouds.weight.new_zeros(())
    for after, (points, normals) in enumerate(network(clouds), 1):
        along = (normals * clouds.true_normals).sum(-1)
        sine = torch.sqrt((1 - along**2).clamp(min=0) + 1e-4)
        off = ((points - clouds.true_points) * clouds.true_normals).sum(-1).abs() / clouds.spacing
        total = total + (1.0 if after == len(network.rounds) else EARLY) * (clouds.weight * (sine + OFF * off)).sum()
    return total


def measured(network: Refinement, shapes: Sequence[Shape]) -> Iterator[str]:
    """Lines with mean angles to the true normals, in degrees, as each point finds its own and as neighbours agree."""
    device = next(network.parameters()).device
    for count, noise in MEASURED:
        angles = []
        for shape in shapes:
            rng = np.random.default_rng(3)
            points, normals = on_shape(shape, count, rng)
            noisy = (points + noise * rng.normal(size=points.shape)).astype(np.float32)
            cloud = patches_of(points, normals, noisy).to(device)
            with torch.no_grad():
                *_, (_, agreed) = network(cloud)
            alongs = [(found * cloud.true_normals).sum(-1).abs().clamp(max=1) for found in (cloud.normals, agreed)]
            angles.append([float(torch.rad2deg(torch.arccos(along)).mean()) for along in alongs])
        alone, agreeing = np.mean(angles, axis=0)
        yield f"{count} points, noise {noise:g}: {alone:.2f} degrees alone, {agreeing:.2f} together"


def patches_of(true_points: np.ndarray, true_normals: np.ndarray, cloud: np.ndarray) -> Patches:
    """A cloud as the network gets it, from points (N, 3) with noise and what they were before it."""
    own, count = fit_local_patches(cloud), len(cloud)
    order = np.empty(count, np.int64)
    order[np.lexsort(own.grid.points.T)] = np.lexsort(cloud.T)  # the grid has sorted them
    points, normals, scale, found, true_points, true_normals = (
        torch.from_numpy(np.ascontiguousarray(array))
        for array in (own.grid.points, own.normals, own.scale, own.neighbors,
                      true_points[order].astype(np.float32), true_normals[order].astype(np.float32))
    )  # fmt: skip
    return Patches(
        points, normals, scale, torch.full((count,), own.noise / own.median_spacing), found,
        torch.full(found.shape, 1 / found.shape[1]), true_points, true_normals, torch.full((count,), own.median_spacing),
        torch.full((count,), 1 / count),
    )  # fmt: skip


if __name__ == "__main__":
    main()
