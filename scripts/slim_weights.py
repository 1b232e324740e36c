"""Makes a leaner network out of a trained one, to go on training from.

    python scripts/slim_weights.py WEIGHTS OUT --widths 48,64,96,128 [--zbuffer paper] [--fine 24 | --coarse]

It keeps the strongest channels and reads no encoding, whose mean goes into the stem. Of splats it may read the first
channel alone, the paper's. With --fine it goes over 2x2 blocks, by layers that begin as nothing, instead of single
pixels; with --coarse over neither. So its pictures are worse at first: `train.start` is what the file is for.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.config import FINE_BLOCK, NetworkConfig, from_dict, to_dict
from z2p_core.network.unet import build_network
from z2p_renderer.pipeline.inference.loading import LoadedNetwork, load_network
from z2p_renderer.storage.models.checkpoints import save_weights

Tensors = dict[str, np.ndarray]
PIXELS = ("look.", "touch.")
"""Layers that go over single pixels."""
PICTURE = 4
"""Channels of the picture, which they read before the buffers."""
SIDE = 256
"""Of the frame over which the encoding's mean is taken; any would do."""


def main() -> None:
    """Write the leaner network."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", help="shipped name or file; one whose picture is gone over in single pixels")
    parser.add_argument("out", type=Path)
    parser.add_argument("--widths", required=True, help="comma-separated, none above what the weights have")
    parser.add_argument("--zbuffer", help="one whose channels are the first of what the weights read")
    parser.add_argument("--fine", type=int, default=0, help="channels to go over 2x2 blocks with")
    parser.add_argument("--coarse", action="store_true", help="not to go over the picture in single pixels")
    asked = parser.parse_args()
    loaded = load_network(asked.weights, to_train=True)
    old = from_dict(NetworkConfig, loaded.card["network"])
    new = replace(old, widths=tuple(int(width) for width in asked.widths.split(",")), encoder="none",
                  zbuffer=asked.zbuffer or old.zbuffer, fine=asked.fine,
                  refine=0 if asked.fine or asked.coarse else old.refine)  # fmt: skip
    zbuffer = registry.load("zbuffers", new.zbuffer)()
    known = {name: tensor.numpy() for name, tensor in loaded.network.state_dict().items()}
    tensors = slimmed(without_inputs(known, loaded, zbuffer.channels), old.widths, new.widths)
    if new.fine:
        tensors = in_blocks(tensors, old.unshuffle)
    if not new.refine:
        tensors = {name: tensor for name, tensor in tensors.items() if not name.startswith(PIXELS)}
    encoder = registry.load("encoders", new.encoder)
    card = {**loaded.card, "network": to_dict(new), "zbuffer": {"name": new.zbuffer, "version": zbuffer.version},
            "encoder": {"name": new.encoder, "version": encoder.version, "state": {}}}  # fmt: skip
    save_weights(asked.out, {**begun(new, loaded, zbuffer.channels), **tensors}, card)


def begun(config: NetworkConfig, loaded: LoadedNetwork, zbuffer_channels: int) -> Tensors:
    """The leaner network before it knows anything: what its new layers begin with."""
    torch.manual_seed(0)
    settings = sum(control.size for control in loaded.controls.values())
    network = build_network(config, zbuffer_channels + loaded.gbuffer.channels, 0, settings)
    return {name: tensor.numpy() for name, tensor in network.state_dict().items()}


def without_inputs(tensors: Tensors, loaded: LoadedNetwork, zbuffer_channels: int) -> Tensors:
    """The layers that read the buffers, with the z-buffer's first channels alone; the encoding's mean in a bias."""
    cell = from_dict(NetworkConfig, loaded.card["network"]).unshuffle
    u, v = Camera(SIDE, SIDE).frame_coordinates(cell)
    encoding = loaded.encoder.encode(u, v).mean(axis=(1, 2))
    stem, buffers = tensors["stem.weight"][:, :, 0, 0], (loaded.zbuffer.channels + loaded.gbuffer.channels) * cell**2
    first, dropped = zbuffer_channels * cell**2, loaded.zbuffer.channels * cell**2
    weight = np.concatenate([stem[:, :first], stem[:, dropped:buffers]], axis=1)[:, :, None, None]
    beside = PICTURE + np.r_[:zbuffer_channels, loaded.zbuffer.channels : buffers // cell**2]
    return {**tensors, "stem.weight": weight, "stem.bias": tensors["stem.bias"] + stem[:, buffers:] @ encoding,
            "look.weight": tensors["look.weight"][:, np.r_[:PICTURE, beside]]}  # fmt: skip


def slimmed(tensors: Tensors, old: tuple[int, ...], new: tuple[int, ...]) -> Tensors:
    """The network with the strongest of each level's channels, and as many of those inside each residual block."""
    kept = [strongest(strength(tensors, level, old), count) for level, count in enumerate(new)]
    slim = dict(tensors)
    for level, rows in enumerate(kept):
        parts = (f"encode.{level}.first.", f"decode.{level}.first.") if level < len(old) - 1 else ("bottom.first.",)
        for name in tensors:
            if name.startswith(parts) and name.endswith(".weight"):
                slim |= slim_block(tensors, name.removesuffix(".weight"), rows)
    for level, (fine, coarse) in enumerate(pairwise(kept)):
        slim |= slim_convolution(tensors, f"shrink.{level}", coarse, fine)
        slim |= slim_convolution(tensors, f"grow.{level}", fine, coarse)
    inputs, whole = np.arange(tensors["stem.weight"].shape[1]), np.arange(len(tensors["head.bias"]))
    slim |= slim_convolution(tensors, "stem", np.concatenate([kept[0], old[0] + whole]), inputs)
    slim |= slim_convolution(tensors, "head", whole, kept[0])
    return slim | slim_affine(tensors, "tint.affine", kept[0])


def strength(tensors: Tensors, level: int, widths: tuple[int, ...]) -> np.ndarray:
    """Of each of a level's channels: how much is written into it, times how much is read of it."""
    written = [f"shrink.{level - 1}", f"grow.{level}"] if level else ["stem", "grow.0"]
    read = [f"shrink.{level}", f"grow.{level - 1}"] if level else ["shrink.0", "head"]
    for part in ("encode", "decode") if level < len(widths) - 1 else ("bottom",):
        prefix = f"{part}.{level}" if part != "bottom" else part
        written += [f"{prefix}.second.{number}" for number in range(2)]
        read += [f"{prefix}.first.{number}" for number in range(2)]
    layers = {name.removesuffix(".weight") for name in tensors}
    inputs, outputs = (
        sum(np.square(tensors[f"{name}.weight"]).sum(axes)[: widths[level]] for name in names if name in layers)
        for names, axes in ((written, (1, 2, 3)), (read, (0, 2, 3)))
    )
    return inputs * outputs


def strongest(strengths: np.ndarray, count: int) -> np.ndarray:
    """Numbers of the channels to keep, in order."""
    if count > len(strengths):
        raise SystemExit(f"widths: expected none above what the weights have, got {count} for {len(strengths)}")
    return np.sort(np.argsort(-strengths)[:count])


def slim_block(tensors: Tensors, first: str, kept: np.ndarray) -> Tensors:
    """A residual block between the kept channels, with as many inside it."""
    second, affine = first.replace("first", "second"), first.replace("first", "modulate") + ".affine"
    written = np.square(tensors[f"{first}.weight"][:, kept]).sum(axis=(1, 2, 3))
    read = np.square(tensors[f"{second}.weight"][kept]).sum(axis=(0, 2, 3))
    inside = strongest(written * read * np.square(1 + np.split(tensors[f"{affine}.bias"], 2)[0]), len(kept))
    return {**slim_convolution(tensors, first, inside, kept), **slim_affine(tensors, affine, inside),
            **slim_convolution(tensors, second, kept, inside)}  # fmt: skip


def slim_convolution(tensors: Tensors, name: str, outputs: np.ndarray, inputs: np.ndarray) -> Tensors:
    """A convolution between some of its channels."""
    weight, bias = tensors[f"{name}.weight"], tensors[f"{name}.bias"]
    return {f"{name}.weight": weight[outputs][:, inputs], f"{name}.bias": bias[outputs]}


def slim_affine(tensors: Tensors, name: str, kept: np.ndarray) -> Tensors:
    """Scale and shift of some channels."""
    both = {key: np.split(tensors[f"{name}.{key}"], 2) for key in ("weight", "bias")}
    return {f"{name}.{key}": np.concatenate([scale[kept], shift[kept]]) for key, (scale, shift) in both.items()}


def in_blocks(tensors: Tensors, cell: int) -> Tensors:
    """The same picture with the pixels of a cell in the order of its 2x2 blocks, in which they are unfolded then."""
    side, ratio = FINE_BLOCK, cell // FINE_BLOCK
    order = np.arange(len(tensors["head.bias"])).reshape(-1, ratio, side, ratio, side)  # colour, rows, columns
    order = order.transpose(0, 2, 4, 1, 3).ravel()
    traced = np.arange(len(tensors["stem.bias"]))
    traced[-len(order) :] = len(traced) - len(order) + order
    changed = {key: tensors[key][order] for key in ("head.weight", "head.bias")}
    return {**tensors, **changed, **{key: tensors[key][traced] for key in ("stem.weight", "stem.bias")}}


if __name__ == "__main__":
    main()
