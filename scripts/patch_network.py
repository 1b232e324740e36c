"""The graph network that refines normals, in torch, and its weights as the C header that ships.

`z2p_core/native/c/points/normal_gnn.c` computes the same. After Satorras et al., E(n) Equivariant Graph Neural
Networks, 2021: hidden units read lengths and angles only, so the network is equivariant to rotations.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import torch
from torch import nn

FEATURES, VOTES = 6, 4
MAX_STEP = 4.0
"""As in `normal_gnn.c`: offsets to neighbors are compressed smoothly to less than this length, in scales."""
NEW_UNIT_SCALE = 0.1
"""Initial weights of units added to a network, relative to those of a new network."""
TITLE = (
    "/* Weights of the network in normal_gnn.c. Written by scripts/learn_patches.py; do not edit. */\n\n"
    "#pragma once\n\n"
)


@dataclass(frozen=True)
class CloudBatch:
    """Clouds as the network gets them, P points in all, K neighbours at most; float32 tensors on one device."""

    points: torch.Tensor
    """(P, 3)"""
    normals: torch.Tensor
    """(P, 3), of either sign"""
    scale: torch.Tensor
    """(P,), above 0"""
    noise: torch.Tensor
    """(P,) in spacings, the same for all points of a cloud"""
    neighbors: torch.Tensor
    """(P, K) int32, rows of the neighbours; those beyond a cloud's own number of them count nothing"""
    share: torch.Tensor
    """(P, K): what a neighbour counts, 1 in all for a point"""
    true_points: torch.Tensor
    """(P, 3), without noise"""
    true_normals: torch.Tensor
    """(P, 3)"""
    spacing: torch.Tensor
    """(P,), the cloud's"""
    weight: torch.Tensor
    """(P,): what a point counts, as much in all for every cloud, 1 together"""

    def to(self, device: torch.device) -> CloudBatch:
        """The same on a device."""
        return CloudBatch(*(getattr(self, each.name).to(device, non_blocking=True) for each in fields(self)))


def merge_clouds(clouds: Sequence[CloudBatch]) -> CloudBatch:
    """Several clouds as one set of points, none of which is another cloud's neighbour."""
    most, begin, rows = max(cloud.neighbors.shape[1] for cloud in clouds), 0, []
    for cloud in clouds:
        rest = cloud.neighbors[:, :1].expand(-1, most - cloud.neighbors.shape[1])  # not one row for all to wait for
        rows.append(torch.cat([cloud.neighbors, rest], dim=1) + begin)
        begin += len(cloud.points)
    joined = {each.name: torch.cat([getattr(cloud, each.name) for cloud in clouds])
              for each in fields(CloudBatch) if each.name not in ("neighbors", "share", "weight")}  # fmt: skip
    share = torch.cat([nn.functional.pad(cloud.share, (0, most - cloud.share.shape[1])) for cloud in clouds])
    weight = torch.cat([cloud.weight for cloud in clouds]) / len(clouds)
    return CloudBatch(**joined, neighbors=torch.cat(rows), share=share, weight=weight)


def _at(rows: torch.Tensor, found: torch.Tensor) -> torch.Tensor:
    """Rows (P, C) of the neighbours (P, K): (P, K, C). On a card its gradient is many times as quick as indexing's."""
    return rows.index_select(0, found.flatten()).view(*found.shape, -1)


class Round(nn.Module):
    """One round of messages, as `z2p_refine_normals` computes it."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.pair = nn.Linear(FEATURES, width)
        self.own, self.other = nn.Linear(width, width, bias=False), nn.Linear(width, width, bias=False)
        self.vote = nn.Linear(width, VOTES, bias=False)
        self.next = nn.Linear(2 * width, width)
        nn.init.zeros_(self.vote.weight)

    def forward(
        self, points: torch.Tensor, normals: torch.Tensor, memory: torch.Tensor, cloud: CloudBatch
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Points, normals and memory after it."""
        step = (_at(points, cloud.neighbors) - points[:, None]) / cloud.scale[:, None, None]
        step = step * torch.rsqrt(1 + (step * step).sum(-1, keepdim=True) / MAX_STEP**2)
        theirs = _at(normals, cloud.neighbors)
        along = (theirs * normals[:, None]).sum(-1)
        theirs = theirs * torch.where(along < 0, -1.0, 1.0)[..., None]
        rise, their_rise, square = (step * normals[:, None]).sum(-1), (step * theirs).sum(-1), (step * step).sum(-1)
        read = [square, rise**2, their_rise**2, rise * their_rise, 1 - along.abs(), torch.sqrt(square + 1e-6)]
        said = torch.relu(
            self.pair(torch.stack(read, -1)) + self.own(memory)[:, None] + _at(self.other(memory), cloud.neighbors)
        )
        votes = self.vote(said) * cloud.share[..., None]
        turn = votes[..., :1] * theirs + (votes[..., 1] * rise + votes[..., 2] * their_rise)[..., None] * step
        lift = (votes[..., 3] * rise).sum(1) * cloud.scale
        heard = (cloud.share[:, None] @ said)[:, 0]
        memory = torch.relu(self.next(torch.cat([memory, heard], -1)))
        return points + lift[:, None] * normals, nn.functional.normalize(normals + turn.sum(1), dim=-1), memory


class NormalNetwork(nn.Module):
    """All rounds. Gives the points and normals after each."""

    def __init__(self, rounds: int, width: int) -> None:
        super().__init__()
        self.width = width
        self.start = nn.Linear(2, width)
        self.rounds = nn.ModuleList(Round(width) for _ in range(rounds))

    def forward(self, cloud: CloudBatch) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        points, normals = cloud.points, cloud.normals
        memory = torch.relu(self.start(torch.stack([cloud.noise, cloud.noise**2], -1)))
        for each in self.rounds:
            points, normals, memory = each(points, normals, memory, cloud)
            yield points, normals


def grow_network(small: NormalNetwork, rounds: int, width: int) -> NormalNetwork:
    """A network of as many rounds and as wide or more that says what the small one says, and can learn more.

    Raises:
        ValueError: it would be smaller.
    """
    if rounds < len(small.rounds) or width < small.width:
        raise ValueError(f"expected {len(small.rounds)} rounds of {small.width} units or more, got {rounds} of {width}")
    network, before = NormalNetwork(rounds, width), small.width
    with torch.no_grad():
        _place(network.start.weight, small.start.weight)
        _place(network.start.bias, small.start.bias)
        for number, (large, known) in enumerate(zip(network.rounds, small.rounds, strict=False)):
            for name in ("pair", "own", "other", "vote"):
                _place(getattr(large, name).weight, getattr(known, name).weight)
            _place(large.pair.bias, known.pair.bias)
            if number + 1 < len(small.rounds):  # what is remembered after the last round it had not learnt
                _place(large.next.weight[:, :width], known.next.weight[:, :before])
                _place(large.next.weight[:, width:], known.next.weight[:, before:])
                _place(large.next.bias, known.next.bias)
    return network


def _place(large: torch.Tensor, small: torch.Tensor) -> None:
    """Puts known weights into the corner of larger ones; known units do not hear new ones, and these begin low."""
    if large.ndim == 1:
        large[: len(small)] = small
        return
    rows, columns = small.shape
    large[:rows, columns:] = 0
    large[rows:] *= NEW_UNIT_SCALE
    large[:rows, :columns] = small


def write_header(path: Path, network: NormalNetwork) -> None:
    """Writes the network as C, with four digits a number."""
    numbers = [f"{number:.4g}" for tensor in header_tensors(network) for number in tensor.flatten().tolist()]
    rows = textwrap.fill(", ".join(numbers), 120, initial_indent="    ", subsequent_indent="    ")
    size = f'#define ROUNDS {len(network.rounds)}\n#define WIDTH {network.width}\n\n#include "points/normal_gnn.h"\n\n'
    path.write_text(f"{TITLE}{size}static const Network NORMAL_GNN_WEIGHTS = {{\n{rows},\n}};\n", encoding="ascii")


def read_header(path: Path) -> NormalNetwork:
    """The network that a header has.

    Raises:
        ValueError: it is no such header, or has another number of numbers than its size asks for.
    """
    text = path.read_text(encoding="ascii")
    sizes = [re.search(rf"#define {name} (\d+)", text) for name in ("ROUNDS", "WIDTH")]
    rounds, width = (int(found[1]) if found else 0 for found in sizes)
    if not rounds or not width:
        raise ValueError(f"{path}: expected a header that defines ROUNDS and WIDTH; learn_patches.py writes such")
    network = NormalNetwork(rounds, width)
    told = [float(number) for number in re.findall(r"-?\d[\d.e+-]*", text.partition("{")[2])]
    wanted = header_tensors(network)
    if len(told) != (count := sum(tensor.numel() for tensor in wanted)):
        raise ValueError(f"{path}: expected {count} numbers for {rounds} rounds of {width} units, got {len(told)}")
    at = 0
    with torch.no_grad():
        for tensor in wanted:
            tensor.copy_(torch.tensor(told[at : at + tensor.numel()]).view(tensor.shape))
            at += tensor.numel()
    return network


def header_tensors(network: NormalNetwork) -> list[torch.Tensor]:
    """Views of the network's numbers, in the header's order."""
    found = [network.start.bias, network.start.weight.T]
    for each in network.rounds:
        assert isinstance(each, Round)
        found += [each.pair.weight.T, each.pair.bias, each.own.weight.T, each.other.weight.T, each.vote.weight]
        if each is not network.rounds[-1]:  # after the last nobody remembers; C fills up with zeros
            found += [each.next.weight.T, each.next.bias]
    return [tensor.detach() for tensor in found]
