"""Weights made ready to draw: the network and the plugins that its card names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import nn

from storage.checkpoints import Weights, WeightsError, check, load_weights, resolve
from z2p_core import registry
from z2p_core.config import ConfigError, NetworkConfig, from_dict
from z2p_core.interfaces import Control, GBuffer, PositionalEncoder, ZBuffer
from z2p_core.model import build_network


@dataclass(frozen=True)
class LoadedNetwork:
    """All that turns a cloud and settings into a picture; the network is in evaluation mode, float32, on the CPU."""

    network: nn.Module
    zbuffer: ZBuffer
    gbuffer: GBuffer
    encoder: PositionalEncoder
    controls: dict[str, Control]
    """In the order of the settings vector."""
    card: dict[str, Any]


def load_network(weights: Weights | str | Path) -> LoadedNetwork:
    """The network and plugins of loaded weights, of a shipped name or of a file.

    Raises:
        WeightsError: the weights are unknown, damaged, or made with plugins of other versions.
        PluginError: a plugin that they need is not installed.
    """
    if not isinstance(weights, Weights):
        weights = load_weights(resolve(weights))
    card = weights.card
    zbuffer, gbuffer = _matching("zbuffers", card["zbuffer"])(), _matching("gbuffers", card["gbuffer"])()
    encoder = _matching("encoders", card["encoder"]).from_state(card["encoder"]["state"])
    controls = {entry["name"]: _control(entry) for entry in card["controls"]}
    settings = sum(control.size for control in controls.values())
    try:
        config = from_dict(NetworkConfig, card["network"], "weights: network")
        network = build_network(config, zbuffer.channels + gbuffer.channels, encoder.channels, settings)
    except (ConfigError, ValueError) as error:
        raise WeightsError(f"weights for a network that this z2p cannot build: {error}") from error
    check(weights, {name: tuple(tensor.shape) for name, tensor in network.state_dict().items()})
    network.load_state_dict({name: torch.from_numpy(tensor) for name, tensor in weights.tensors.items()})
    network.to(memory_format=torch.channels_last).eval()
    return LoadedNetwork(network, zbuffer, gbuffer, encoder, controls, card)


def _matching(group: str, entry: dict[str, Any]) -> type[Any]:
    """The plugin class of a card's entry, of the very version that the weights were trained with."""
    plugin = registry.load(group, entry["name"])
    if plugin.version != entry["version"]:
        raise WeightsError(
            f"weights need {group[:-1]} {entry['name']!r} version {entry['version']}, installed is {plugin.version}; "
            "install that version or train again"
        )
    return plugin


def _control(entry: dict[str, Any]) -> Control:
    control: Control = _matching("controls", entry)()
    if control.size != entry["size"]:
        raise WeightsError(
            f"weights give control {entry['name']!r} {entry['size']} settings, the installed one has {control.size}; "
            "install the control they were trained with or train again"
        )
    return control
