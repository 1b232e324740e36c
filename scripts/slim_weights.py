"""Prunes a trained network to a smaller one, as a start for further training.

    python scripts/slim_weights.py WEIGHTS OUT --widths 48,64,96,128 [--zbuffer paper] [--fine 24 | --coarse]

Keeps the strongest channels, and drops the encoding, whose mean goes into the stem's bias. Of the splats z-buffer it
may keep the first channel alone, the paper's. --fine replaces the final convolutions on single pixels by new ones on
2x2 blocks; --coarse removes them. The pruned network is worse until it is trained again (`train.start`).
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
FINAL_CONVOLUTIONS = ("look.", "touch.")
"""Prefixes of the final convolutions, on single pixels."""
IMAGE_CHANNELS = 4
"""Channels of the image, which the final convolutions read before the buffers."""
FRAME_SIDE = 256
"""Side of the frame over which the encoding is averaged; its value hardly matters."""


def main() -> None:
    """Writes the pruned network."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", help="shipped name or file; one whose picture is gone over in single pixels")
    parser.add_argument("out", type=Path)
    parser.add_argument("--widths", required=True, help="comma-separated, none above what the weights have")
    parser.add_argument("--zbuffer", help="one whose channels are the first of what the weights read")
    parser.add_argument("--fine", type=int, default=0, help="channels to go over 2x2 blocks with")
    parser.add_argument("--coarse", action="store_true", help="not to go over the picture in single pixels")
    options = parser.parse_args()
    loaded = load_network(options.weights, to_train=True)
    old = from_dict(NetworkConfig, loaded.card["network"])
    new = replace(old, widths=tuple(int(width) for width in options.widths.split(",")), encoder="none",
                  zbuffer=options.zbuffer or old.zbuffer, fine=options.fine,
                  refine=0 if options.fine or options.coarse else old.refine)  # fmt: skip
    zbuffer = registry.load("zbuffers", new.zbuffer)()
    known = {name: tensor.numpy() for name, tensor in loaded.network.state_dict().items()}
    tensors = prune(drop_inputs(known, loaded, zbuffer.channels), old.widths, new.widths)
    if new.fine:
        tensors = reorder_to_blocks(tensors, old.unshuffle)
    if not new.refine:
        tensors = {name: tensor for name, tensor in tensors.items() if not name.startswith(FINAL_CONVOLUTIONS)}
    encoder = registry.load("encoders", new.encoder)
    card = {**loaded.card, "network": to_dict(new), "zbuffer": {"name": new.zbuffer, "version": zbuffer.version},
            "encoder": {"name": new.encoder, "version": encoder.version, "state": {}}}  # fmt: skip
    save_weights(options.out, {**initial_tensors(new, loaded, zbuffer.channels), **tensors}, card)


def initial_tensors(config: NetworkConfig, loaded: LoadedNetwork, zbuffer_channels: int) -> Tensors:
    """Randomly initialised tensors of the pruned network, for its new layers."""
    torch.manual_seed(0)
    settings = sum(control.size for control in loaded.controls.values())
    network = build_network(config, zbuffer_channels + loaded.gbuffer.channels, 0, settings)
    return {name: tensor.numpy() for name, tensor in network.state_dict().items()}


def drop_inputs(tensors: Tensors, loaded: LoadedNetwork, zbuffer_channels: int) -> Tensors:
    """Tensors that read the z-buffer's first channels alone, and have the encoding's mean in the stem's bias."""
    cell = from_dict(NetworkConfig, loaded.card["network"]).unshuffle
    u, v = Camera(FRAME_SIDE, FRAME_SIDE).frame_coordinates(cell)
    encoding = loaded.encoder.encode(u, v).mean(axis=(1, 2))
    stem, buffers = tensors["stem.weight"][:, :, 0, 0], (loaded.zbuffer.channels + loaded.gbuffer.channels) * cell**2
    first, dropped = zbuffer_channels * cell**2, loaded.zbuffer.channels * cell**2
    weight = np.concatenate([stem[:, :first], stem[:, dropped:buffers]], axis=1)[:, :, None, None]
    buffer_channels = IMAGE_CHANNELS + np.r_[:zbuffer_channels, loaded.zbuffer.channels : buffers // cell**2]
    return {**tensors, "stem.weight": weight, "stem.bias": tensors["stem.bias"] + stem[:, buffers:] @ encoding,
            "look.weight": tensors["look.weight"][:, np.r_[:IMAGE_CHANNELS, buffer_channels]]}  # fmt: skip


def prune(tensors: Tensors, old: tuple[int, ...], new: tuple[int, ...]) -> Tensors:
    """The network with the strongest channels of each level, and as many inside each residual block."""
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
    inputs, all_outputs = np.arange(tensors["stem.weight"].shape[1]), np.arange(len(tensors["head.bias"]))
    slim |= slim_convolution(tensors, "stem", np.concatenate([kept[0], old[0] + all_outputs]), inputs)
    slim |= slim_convolution(tensors, "head", all_outputs, kept[0])
    return slim | slim_affine(tensors, "tint.affine", kept[0])


def strength(tensors: Tensors, level: int, widths: tuple[int, ...]) -> np.ndarray:
    """Strength of each channel of a level: squared norm of its incoming weights times that of its outgoing ones."""
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
    """Sorted indices of the `count` strongest channels."""
    if count > len(strengths):
        raise SystemExit(f"widths: expected none above what the weights have, got {count} for {len(strengths)}")
    return np.sort(np.argsort(-strengths)[:count])


def slim_block(tensors: Tensors, first: str, kept: np.ndarray) -> Tensors:
    """A residual block restricted to the kept channels, with as many inner ones."""
    second, affine = first.replace("first", "second"), first.replace("first", "modulate") + ".affine"
    written = np.square(tensors[f"{first}.weight"][:, kept]).sum(axis=(1, 2, 3))
    read = np.square(tensors[f"{second}.weight"][kept]).sum(axis=(0, 2, 3))
    inside = strongest(written * read * np.square(1 + np.split(tensors[f"{affine}.bias"], 2)[0]), len(kept))
    return {**slim_convolution(tensors, first, inside, kept), **slim_affine(tensors, affine, inside),
            **slim_convolution(tensors, second, kept, inside)}  # fmt: skip


def slim_convolution(tensors: Tensors, name: str, outputs: np.ndarray, inputs: np.ndarray) -> Tensors:
    """A convolution restricted to some inputs and outputs."""
    weight, bias = tensors[f"{name}.weight"], tensors[f"{name}.bias"]
    return {f"{name}.weight": weight[outputs][:, inputs], f"{name}.bias": bias[outputs]}


def slim_affine(tensors: Tensors, name: str, kept: np.ndarray) -> Tensors:
    """A scale-and-shift layer restricted to some channels."""
    both = {key: np.split(tensors[f"{name}.{key}"], 2) for key in ("weight", "bias")}
    return {f"{name}.{key}": np.concatenate([scale[kept], shift[kept]]) for key, (scale, shift) in both.items()}


def reorder_to_blocks(tensors: Tensors, cell: int) -> Tensors:
    """An equivalent head and stem whose output has a cell's pixels in the order of its 2x2 blocks."""
    side, ratio = FINE_BLOCK, cell // FINE_BLOCK
    order = np.arange(len(tensors["head.bias"])).reshape(-1, ratio, side, ratio, side)  # colour, rows, columns
    order = order.transpose(0, 2, 4, 1, 3).ravel()
    traced = np.arange(len(tensors["stem.bias"]))
    traced[-len(order) :] = len(traced) - len(order) + order
    changed = {key: tensors[key][order] for key in ("head.weight", "head.bias")}
    return {**tensors, **changed, **{key: tensors[key][traced] for key in ("stem.weight", "stem.bias")}}


if __name__ == "__main__":
    main()
