"""Names and shapes of the tensors of a network of `z2p_core.network.unet`, from its configuration alone.

Nothing is built or allocated. So untrusted weights can be compared with their card without torch, and before anything
is made of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import prod

from z2p_core.config import FINE_BLOCK, NetworkConfig
from z2p_core.errors.value_limits import Choice, Count, Limit, ListOf

MAX_WEIGHTS = 500_000_000
"""Largest number of weights of a network; the largest one that ships has 3 million."""
KINDS = ("unshuffle_unet", "adain_unet")
CONDITIONINGS = ("adain", "input")
SIZE_LIMITS: dict[str, Limit] = {
    "widths": ListOf(Count(1, 4096), 2, 10),
    "unshuffle": Count(1, 64),
    "fine": Count(0, 4096),
    "refine": Count(0, 4096),
    "mapping": Count(1, 16_384),
    "conditioning": Choice(CONDITIONINGS),
}
"""Limits of each field of a network's configuration or card: absurd sizes are refused before anything else."""
Shapes = dict[str, tuple[int, ...]]
"""Shape of each tensor by its name in the state dict."""


def network_config_fault(config: NetworkConfig) -> str:
    """Message, beginning with the key, on fields of a configuration that do not fit each other; "" if all do."""
    if config.kind not in KINDS:
        return f"kind: unknown network {config.kind!r}; known: {', '.join(KINDS)}"
    if len(config.widths) < 2 or min(*config.widths, config.mapping, config.unshuffle, config.refine + 1) < 1:
        return ("widths: expected two or more widths, a mapping and an unshuffle above 0, refine not below, got "
                f"{config}")
    if config.kind == "adain_unet" and config.unshuffle != 1:
        return f"unshuffle: adain_unet works at full resolution: expected unshuffle = 1, got {config.unshuffle}"
    if config.kind == "unshuffle_unet" and config.fine and config.unshuffle % FINE_BLOCK:
        return f"fine: fine needs an unshuffle that {FINE_BLOCK} divides, got {config.unshuffle}"
    known = CONDITIONINGS[:1] if config.kind == "adain_unet" else CONDITIONINGS
    if config.conditioning not in known:
        return f"{config.kind}: conditioning: expected {' or '.join(known)}, got {config.conditioning!r}"
    weights = sum(map(prod, network_shapes(config, 1, 0, 1).values()))
    if weights > MAX_WEIGHTS:
        return f"widths: expected a network of at most {MAX_WEIGHTS:,} weights, got {weights:,}"
    return ""


def network_shapes(config: NetworkConfig, buffer_channels: int, encoder_channels: int, settings: int) -> Shapes:
    """Shape of every tensor in the state dict of the network that `build_network` makes of these arguments."""
    layers = _unshuffle_unet if config.kind == "unshuffle_unet" else _adain_unet
    shapes = dict(layers(config, buffer_channels, encoder_channels, settings))
    if config.conditioning == "adain":
        inputs = (settings, config.mapping, config.mapping)
        for layer, before in zip((0, 2, 4), inputs, strict=True):
            shapes |= _with_bias(f"mapping.layers.{layer}", config.mapping, before)
    return shapes


def _unshuffle_unet(
    config: NetworkConfig, buffer_channels: int, encoder_channels: int, settings: int
) -> Iterator[tuple[str, tuple[int, ...]]]:
    widths, cell = config.widths, config.unshuffle**2
    setting_planes = settings if config.conditioning == "input" else 0
    inputs = buffer_channels * cell + encoder_channels + setting_planes
    yield from _with_bias("stem", widths[0] + 4 * cell, inputs, 1, 1).items()
    for level, (fine, coarse) in enumerate(pairwise(widths)):
        yield from _residual(f"encode.{level}", 1, fine, config)
        yield from _with_bias(f"shrink.{level}", coarse, fine, 2, 2).items()
        yield from _with_bias(f"grow.{level}", fine, coarse, 1, 1).items()
        yield from _residual(f"decode.{level}", 2, fine, config)
    yield from _residual("bottom", 2, widths[-1], config)
    yield from _modulation("tint", widths[0], config)
    yield from _with_bias("head", 4 * cell, widths[0], 3, 3).items()
    if config.fine:
        side, blocks = 2 * FINE_BLOCK, 4 * FINE_BLOCK**2
        yield from _with_bias("sharpen.look", config.fine, buffer_channels, side, side).items()
        yield from _with_bias("sharpen.reread", config.fine, blocks, 3, 3).items()
        yield from _with_bias("sharpen.leave", blocks, config.fine, 3, 3).items()
    if config.refine:
        yield from _with_bias("look", config.refine, 4 + buffer_channels, 3, 3).items()
        yield from _with_bias("touch", 4, config.refine, 3, 3).items()


def _adain_unet(
    config: NetworkConfig, buffer_channels: int, encoder_channels: int, settings: int
) -> Iterator[tuple[str, tuple[int, ...]]]:
    widths = config.widths
    inputs = (buffer_channels + encoder_channels, *widths[:-1])
    for level, (before, after) in enumerate(zip(inputs, widths, strict=True)):
        yield from _convolutions(f"encode.{level}", before, after, config)
    for level, (fine, coarse) in enumerate(pairwise(widths)):
        yield f"grow.{level}.weight", (coarse, fine, 2, 2)
        yield f"grow.{level}.bias", (fine,)
        yield from _convolutions(f"decode.{level}", 2 * fine, fine, config)
    yield from _with_bias("head", 4, widths[0], 1, 1).items()


def _residual(name: str, count: int, width: int, config: NetworkConfig) -> Iterator[tuple[str, tuple[int, ...]]]:
    for index in range(count):
        yield from _with_bias(f"{name}.first.{index}", width, width, 3, 3).items()
        yield from _modulation(f"{name}.modulate.{index}", width, config)
        yield from _with_bias(f"{name}.second.{index}", width, width, 3, 3).items()


def _modulation(name: str, channels: int, config: NetworkConfig) -> Iterator[tuple[str, tuple[int, ...]]]:
    if config.conditioning == "adain":
        yield from _with_bias(f"{name}.affine", 2 * channels, config.mapping).items()


def _convolutions(name: str, before: int, after: int, config: NetworkConfig) -> Iterator[tuple[str, tuple[int, ...]]]:
    for which, inputs in (("first", before), ("second", after)):
        yield f"{name}.{which}.weight", (after, inputs, 3, 3)
        yield from _modulation(f"{name}.{which}_modulation", after, config)


def _with_bias(name: str, outputs: int, *rest: int) -> Shapes:
    return {f"{name}.weight": (outputs, *rest), f"{name}.bias": (outputs,)}
