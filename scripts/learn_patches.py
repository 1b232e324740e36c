"""Teaches the small network that lets neighbouring points agree upon their patches, and writes it as C.

    python scripts/learn_patches.py MESHES [MESHES ...] [--steps 5000] [--begin HEADER] [--output HEADER]
    python scripts/learn_patches.py MESHES --begin HEADER --steps 0 --measure OTHERS

Clouds are drawn from the meshes as scanners and samplers draw them (`scanned_clouds.py`). What `z2p_core/tangents.py`
finds without the network is what it begins with; the meshes' own normals, and where the points lay before the noise,
are what it should find. HEADER is `z2p_core/native/refine_weights.h` unless another is named. Install z2p again to
compile it, and train the weights some more, which have learnt from patches as they were.
"""

from __future__ import annotations

import argparse
import math
import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scanned_clouds import Shape, drawn, on_shape, shape_of
from torch import nn
from tqdm import tqdm

from storage.meshes import find_meshes
from z2p_core.tangents import fitted

HEADER = Path(__file__).resolve().parent.parent / "z2p_core" / "native" / "refine_weights.h"
ROUNDS, WIDTH, FEATURES, VOTES = 3, 16, 6, 4
REACH = 4.0
"""As in `refine.c`: in scale, of the longest step to a neighbour."""
CLOUDS = 2
"""A step learns from so many."""
RATE, WARM = 4e-3, 100
"""Rate of learning at most, and steps until it is reached; it ends near 0."""
MEASURED = ((2048, 0.0), (5000, 0.0), (5000, 0.01), (5000, 0.02), (20_000, 0.01))
"""Points, and noise in the radius of the shape."""
EARLY, OFF = 0.3, 0.3
"""Weights in the loss: of what rounds before the last say, and of points off their surface, in spacings, against the
sine of the angle between normals."""
TITLE = "/* What scripts/learn_patches.py has learnt, which writes this file; refine.c uses it. */\n\n#pragma once\n\n"


@dataclass(frozen=True)
class Example:
    """A cloud as the network gets it: points, normals, scale, neighbours and noise in spacings; and what is true."""

    points: torch.Tensor
    normals: torch.Tensor
    found: torch.Tensor
    scale: torch.Tensor
    noise: float
    spacing: float
    true_points: torch.Tensor
    true_normals: torch.Tensor


class Round(nn.Module):
    """One round of messages, as `z2p_refine` computes it."""

    def __init__(self) -> None:
        super().__init__()
        self.pair = nn.Linear(FEATURES, WIDTH)
        self.own, self.other = nn.Linear(WIDTH, WIDTH, bias=False), nn.Linear(WIDTH, WIDTH, bias=False)
        self.vote = nn.Linear(WIDTH, VOTES, bias=False)
        self.next = nn.Linear(2 * WIDTH, WIDTH)
        nn.init.zeros_(self.vote.weight)

    def forward(
        self, points: torch.Tensor, normals: torch.Tensor, memory: torch.Tensor, cloud: Example
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Points, normals and memory after it."""
        step = (points[cloud.found] - points[:, None]) / cloud.scale[:, None, None]
        step = step * torch.rsqrt(1 + (step * step).sum(-1, keepdim=True) / REACH**2)
        theirs = normals[cloud.found]
        along = (theirs * normals[:, None]).sum(-1)
        theirs = theirs * torch.where(along < 0, -1.0, 1.0)[..., None]
        rise, their_rise, square = (step * normals[:, None]).sum(-1), (step * theirs).sum(-1), (step * step).sum(-1)
        read = [square, rise**2, their_rise**2, rise * their_rise, 1 - along.abs(), torch.sqrt(square + 1e-6)]
        said = torch.relu(
            self.pair(torch.stack(read, -1)) + self.own(memory)[:, None] + self.other(memory)[cloud.found]
        )
        votes = self.vote(said)
        turn = votes[..., :1] * theirs + (votes[..., 1] * rise + votes[..., 2] * their_rise)[..., None] * step
        lift = (votes[..., 3] * rise).mean(1) * cloud.scale
        memory = torch.relu(self.next(torch.cat([memory, said.mean(1)], -1)))
        return points + lift[:, None] * normals, nn.functional.normalize(normals + turn.mean(1), dim=-1), memory


class Refinement(nn.Module):
    """All rounds. Gives the points and normals after each."""

    def __init__(self) -> None:
        super().__init__()
        self.start = nn.Linear(2, WIDTH)
        self.rounds = nn.ModuleList(Round() for _ in range(ROUNDS))
        for unused in self.rounds[-1].next.parameters():  # type: ignore[union-attr,operator]
            nn.init.zeros_(unused)

    def forward(self, cloud: Example) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        points, normals = cloud.points, cloud.normals
        memory = torch.relu(self.start(torch.tensor([cloud.noise, cloud.noise**2]))).expand(len(points), -1)
        for each in self.rounds:
            points, normals, memory = each(points, normals, memory, cloud)
            yield points, normals


def main() -> None:
    """Learn, and write the header."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", type=Path, help="folders of meshes to learn from")
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--begin", type=Path, help="a header to go on from")
    parser.add_argument("--output", type=Path, default=HEADER)
    parser.add_argument("--measure", type=Path, help="a folder of other meshes, to measure it on")
    asked = parser.parse_args()
    shapes = [shape_of(path) for folder in asked.meshes for path in find_meshes(folder).values()]
    torch.manual_seed(asked.seed)
    network = read_header(asked.begin) if asked.begin else Refinement()
    learn(network, shapes, asked.steps, np.random.default_rng(asked.seed))
    write_header(asked.output, network)
    if asked.measure:
        measure(network, [shape_of(path) for path in find_meshes(asked.measure).values()])


def learn(network: Refinement, shapes: list[Shape], steps: int, rng: np.random.Generator) -> None:
    """Teaches the network with clouds of the shapes."""
    optimizer = torch.optim.Adam(network.parameters())
    for step in (bar := tqdm(range(steps))):
        for group in optimizer.param_groups:
            group["lr"] = RATE * min(1.0, (step + 1) / WARM) * (0.5 + 0.5 * math.cos(math.pi * step / steps))
        optimizer.zero_grad()
        for _ in range(CLOUDS):
            loss = loss_of(network, example(*drawn(shapes[rng.integers(len(shapes))], rng)))
            (loss / CLOUDS).backward()
        nn.utils.clip_grad_norm_(network.parameters(), 0.5)
        optimizer.step()
        if step % 100 == 0:
            bar.set_postfix(loss=f"{loss.item():.3f}")


def measure(network: Refinement, shapes: list[Shape]) -> None:
    """Prints mean angles to the true normals, in degrees, as each point finds its own and as neighbours agree."""
    for count, noise in MEASURED:
        angles = []
        for shape in shapes:
            rng = np.random.default_rng(3)
            points, normals = on_shape(shape, count, rng)
            cloud = example(points, normals, (points + noise * rng.normal(size=points.shape)).astype(np.float32))
            with torch.no_grad():
                *_, (_, agreed) = network(cloud)
            alongs = [(found * cloud.true_normals).sum(-1).abs().clamp(max=1) for found in (cloud.normals, agreed)]
            angles.append([float(torch.rad2deg(torch.arccos(along)).mean()) for along in alongs])
        alone, together = np.mean(angles, axis=0)
        print(f"{count} points, noise {noise:g}: {alone:.2f} degrees alone, {together:.2f} together")


def loss_of(network: Refinement, cloud: Example) -> torch.Tensor:
    """Sines of the angles to the true normals, of either sign, and distances from the surface; means."""
    total = torch.zeros(())
    for after, (points, normals) in enumerate(network(cloud), 1):
        along = (normals * cloud.true_normals).sum(-1)
        sine = torch.sqrt((1 - along**2).clamp(min=0) + 1e-4)
        off = ((points - cloud.true_points) * cloud.true_normals).sum(-1).abs() / cloud.spacing
        total = total + (1.0 if after == ROUNDS else EARLY) * (sine.mean() + OFF * off.mean())
    return total


def example(true_points: np.ndarray, true_normals: np.ndarray, cloud: np.ndarray) -> Example:
    """A cloud as the network gets it, from points (N, 3) with noise and what they were before it."""
    own = fitted(cloud)
    order = np.empty(len(cloud), np.int64)
    order[np.lexsort(own.grid.points.T)] = np.lexsort(cloud.T)  # the grid has sorted them
    arrays = (own.grid.points, own.normals, own.neighbours.astype(np.int64), own.scale)
    return Example(
        *(torch.from_numpy(array) for array in arrays), own.noise / own.typical, own.typical,
        *(torch.from_numpy(array[order].astype(np.float32)) for array in (true_points, true_normals)),
    )  # fmt: skip


def write_header(path: Path, network: Refinement) -> None:
    """Writes the network as C, with four digits a number."""
    numbers = [f"{number:.4g}" for tensor in numbers_of(network) for number in tensor.flatten().tolist()]
    rows = textwrap.fill(", ".join(numbers), 120, initial_indent="    ", subsequent_indent="    ")
    path.write_text(f"{TITLE}static const Network LEARNT = {{\n{rows},\n}};\n", encoding="ascii")


def read_header(path: Path) -> Refinement:
    """The network that a header has.

    Raises:
        ValueError: it has another number of numbers.
    """
    network = Refinement()
    told = [float(number) for number in re.findall(r"-?\d[\d.e+-]*", path.read_text().partition("{")[2])]
    wanted = numbers_of(network)
    if len(told) != (count := sum(tensor.numel() for tensor in wanted)):
        raise ValueError(f"expected a header of {count} numbers, got {len(told)} in {path}: it is of another network")
    at = 0
    with torch.no_grad():
        for tensor in wanted:
            tensor.copy_(torch.tensor(told[at : at + tensor.numel()]).view(tensor.shape))
            at += tensor.numel()
    return network


def numbers_of(network: Refinement) -> list[torch.Tensor]:
    """Views of the network's numbers, in the header's order."""
    found = [network.start.bias, network.start.weight.T]
    for each in network.rounds:
        assert isinstance(each, Round)
        found += [each.pair.weight.T, each.pair.bias, each.own.weight.T, each.other.weight.T, each.vote.weight]
        if each is not network.rounds[-1]:  # after the last nobody remembers; C fills up with zeros
            found += [each.next.weight.T, each.next.bias]
    return [tensor.detach() for tensor in found]


if __name__ == "__main__":
    main()
