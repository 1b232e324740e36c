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

FEATURES, OUTPUTS = 6, 4
"""Rotation-invariant features of a neighbor; coefficients of its normal, its offset (by either height) and its height,
as in `normal_gnn.h`."""
MAX_STEP = 4.0
"""As in `normal_gnn.c`: offsets to neighbors are compressed smoothly to less than this length, in scales."""
NEW_UNIT_SCALE = 0.1
"""Initial weights of units added to a network, relative to those of a new network."""
TITLE = (
    "/* Weights of the network in normal_gnn.c. Written by scripts/train_normal_gnn.py; do not edit. */\n\n"
    "#pragma once\n\n"
)


@dataclass(frozen=True)
class CloudBatch:
    """The network's input and targets: clouds of P points together, K neighbors at most; float32 on one device."""

    points: torch.Tensor
    """(P, 3)"""
    normals: torch.Tensor
    """(P, 3), of either sign"""
    scale: torch.Tensor
    """(P,), above 0"""
    noise: torch.Tensor
    """(P,), in spacings, the same for all points of a cloud"""
    neighbors: torch.Tensor
    """(P, K) int32, rows of the neighbors; clouds with fewer are padded with neighbors of share 0"""
    share: torch.Tensor
    """(P, K), weights of the neighbors, of sum 1 for each point"""
    true_points: torch.Tensor
    """(P, 3), without noise"""
    true_normals: torch.Tensor
    """(P, 3)"""
    spacing: torch.Tensor
    """(P,), the cloud's"""
    weight: torch.Tensor
    """(P,), weights of the points in the loss: the same sum for every cloud, 1 together"""

    def to(self, device: torch.device) -> CloudBatch:
        """The batch on a device."""
        return CloudBatch(*(getattr(self, each.name).to(device, non_blocking=True) for each in fields(self)))


def merge_clouds(clouds: Sequence[CloudBatch]) -> CloudBatch:
    """Several clouds as one batch; neighbors stay within their cloud."""
    max_count, begin, rows = max(cloud.neighbors.shape[1] for cloud in clouds), 0, []
    for cloud in clouds:
        # repeats each point's first neighbor, since padding all points by one row would serialize the gradient
        rest = cloud.neighbors[:, :1].expand(-1, max_count - cloud.neighbors.shape[1])
        rows.append(torch.cat([cloud.neighbors, rest], dim=1) + begin)
        begin += len(cloud.points)
    joined = {each.name: torch.cat([getattr(cloud, each.name) for cloud in clouds])
              for each in fields(CloudBatch) if each.name not in ("neighbors", "share", "weight")}  # fmt: skip
    share = torch.cat([nn.functional.pad(cloud.share, (0, max_count - cloud.share.shape[1])) for cloud in clouds])
    weight = torch.cat([cloud.weight for cloud in clouds]) / len(clouds)
    return CloudBatch(**joined, neighbors=torch.cat(rows), share=share, weight=weight)


def _gather(rows: torch.Tensor, neighbors: torch.Tensor) -> torch.Tensor:
    """Rows (P, C) of the neighbors (P, K): (P, K, C). On a GPU its gradient is far faster than that of indexing."""
    return rows.index_select(0, neighbors.flatten()).view(*neighbors.shape, -1)


class Round(nn.Module):
    """One round of messages, as `z2p_refine_normals` computes it."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.pair = nn.Linear(FEATURES, width)
        self.own, self.other = nn.Linear(width, width, bias=False), nn.Linear(width, width, bias=False)
        self.output = nn.Linear(width, OUTPUTS, bias=False)
        self.next = nn.Linear(2 * width, width)
        nn.init.zeros_(self.output.weight)

    def forward(
        self, points: torch.Tensor, normals: torch.Tensor, state: torch.Tensor, cloud: CloudBatch
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Points (P, 3), normals (P, 3) and states (P, width) after the round."""
        offset = (_gather(points, cloud.neighbors) - points[:, None]) / cloud.scale[:, None, None]
        offset = offset * torch.rsqrt(1 + (offset * offset).sum(-1, keepdim=True) / MAX_STEP**2)
        aligned = _gather(normals, cloud.neighbors)
        cosine = (aligned * normals[:, None]).sum(-1)
        aligned = aligned * torch.where(cosine < 0, -1.0, 1.0)[..., None]
        height, other_height = (offset * normals[:, None]).sum(-1), (offset * aligned).sum(-1)
        length_sq = (offset * offset).sum(-1)
        features = [length_sq, height**2, other_height**2, height * other_height, 1 - cosine.abs(),
                    torch.sqrt(length_sq + 1e-6)]  # fmt: skip
        message = _gather(self.other(state), cloud.neighbors)
        hidden = torch.relu(self.pair(torch.stack(features, -1)) + self.own(state)[:, None] + message)
        output = self.output(hidden) * cloud.share[..., None]
        by_height = output[..., 1] * height + output[..., 2] * other_height
        correction = output[..., :1] * aligned + by_height[..., None] * offset
        shift = (output[..., 3] * height).sum(1) * cloud.scale
        aggregate = (cloud.share[:, None] @ hidden)[:, 0]
        state = torch.relu(self.next(torch.cat([state, aggregate], -1)))
        return points + shift[:, None] * normals, nn.functional.normalize(normals + correction.sum(1), dim=-1), state


class NormalNetwork(nn.Module):
    """All rounds of messages; yields the points (P, 3) and normals (P, 3) after each."""

    def __init__(self, rounds: int, width: int) -> None:
        super().__init__()
        self.width = width
        self.start = nn.Linear(2, width)
        self.rounds = nn.ModuleList(Round(width) for _ in range(rounds))

    def forward(self, cloud: CloudBatch) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        points, normals = cloud.points, cloud.normals
        state = torch.relu(self.start(torch.stack([cloud.noise, cloud.noise**2], -1)))
        for each in self.rounds:
            points, normals, state = each(points, normals, state, cloud)
            yield points, normals


def grow_network(small: NormalNetwork, rounds: int, width: int) -> NormalNetwork:
    """A network of at least as many rounds and units, whose outputs are those of the small one until it is trained.

    Raises:
        ValueError: the network would be smaller.
    """
    if rounds < len(small.rounds) or width < small.width:
        raise ValueError(f"expected {len(small.rounds)} rounds of {small.width} units or more, got {rounds} of {width}")
    network, old_width = NormalNetwork(rounds, width), small.width
    with torch.no_grad():
        _copy_into_corner(network.start.weight, small.start.weight)
        _copy_into_corner(network.start.bias, small.start.bias)
        for number, (large, trained) in enumerate(zip(network.rounds, small.rounds, strict=False)):
            for name in ("pair", "own", "other", "output"):
                _copy_into_corner(getattr(large, name).weight, getattr(trained, name).weight)
            _copy_into_corner(large.pair.bias, trained.pair.bias)
            if number + 1 < len(small.rounds):  # the last round of the small network has no trained state update
                _copy_into_corner(large.next.weight[:, :width], trained.next.weight[:, :old_width])
                _copy_into_corner(large.next.weight[:, width:], trained.next.weight[:, old_width:])
                _copy_into_corner(large.next.bias, trained.next.bias)
    return network


def _copy_into_corner(large: torch.Tensor, small: torch.Tensor) -> None:
    """Copies trained weights into the corner of larger ones. Trained units ignore new ones, which begin small."""
    if large.ndim == 1:
        large[: len(small)] = small
        return
    rows, columns = small.shape
    large[:rows, columns:] = 0
    large[rows:] *= NEW_UNIT_SCALE
    large[:rows, :columns] = small


def write_header(path: Path, network: NormalNetwork) -> None:
    """Writes the network's weights as a C header, with four significant digits."""
    numbers = [f"{number:.4g}" for tensor in header_tensors(network) for number in tensor.flatten().tolist()]
    rows = textwrap.fill(", ".join(numbers), 120, initial_indent="    ", subsequent_indent="    ")
    size = f'#define ROUNDS {len(network.rounds)}\n#define WIDTH {network.width}\n\n#include "points/normal_gnn.h"\n\n'
    path.write_text(f"{TITLE}{size}static const Network NORMAL_GNN_WEIGHTS = {{\n{rows},\n}};\n", encoding="ascii")


def read_header(path: Path) -> NormalNetwork:
    """The network of a header that `write_header` wrote.

    Raises:
        ValueError: the file is no such header, or has another number of weights than its size needs.
    """
    text = path.read_text(encoding="ascii")
    sizes = [re.search(rf"#define {name} (\d+)", text) for name in ("ROUNDS", "WIDTH")]
    rounds, width = (int(match[1]) if match else 0 for match in sizes)
    if not rounds or not width:
        raise ValueError(f"{path}: expected a header that defines ROUNDS and WIDTH; train_normal_gnn.py writes such")
    network = NormalNetwork(rounds, width)
    numbers = [float(number) for number in re.findall(r"-?\d[\d.e+-]*", text.partition("{")[2])]
    tensors = header_tensors(network)
    if len(numbers) != (count := sum(tensor.numel() for tensor in tensors)):
        raise ValueError(f"{path}: expected {count} numbers for {rounds} rounds of {width} units, got {len(numbers)}")
    start = 0
    with torch.no_grad():
        for tensor in tensors:
            tensor.copy_(torch.tensor(numbers[start : start + tensor.numel()]).view(tensor.shape))
            start += tensor.numel()
    return network


def header_tensors(network: NormalNetwork) -> list[torch.Tensor]:
    """Views of the network's weights, in the header's order."""
    tensors = [network.start.bias, network.start.weight.T]
    for each in network.rounds:
        assert isinstance(each, Round)
        tensors += [each.pair.weight.T, each.pair.bias, each.own.weight.T, each.other.weight.T, each.output.weight]
        if each is not network.rounds[-1]:  # the last round has no state update; C fills the rest with zeros
            tensors += [each.next.weight.T, each.next.bias]
    return [tensor.detach() for tensor in tensors]
