"""Weights made ready to draw: the plugins that their card names, and the network in the form that its engine takes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from z2p_core import registry
from z2p_core.config import ConfigError, NetworkConfig, from_dict
from z2p_core.errors.value_limits import describe_value
from z2p_core.interfaces import Condition, Control, GBuffer, PositionalEncoder, ZBuffer
from z2p_core.network.tensor_shapes import network_config_fault, network_shapes
from z2p_renderer.storage.models.checkpoints import Weights, WeightsError, check_tensors, find_weights, load_weights

if TYPE_CHECKING:
    from torch import nn


MAX_ENCODER_CHANNELS = 4096
"""Channels that an encoder may give."""


class MissingPlugin(WeightsError, registry.PluginError):
    """Weights that need a plugin that is not installed."""


@dataclass(frozen=True)
class LoadedWeights:
    """Weights with the plugins that feed their network; nothing of it needs torch."""

    weights: Weights
    config: NetworkConfig
    zbuffer: ZBuffer
    gbuffer: GBuffer
    encoder: PositionalEncoder
    controls: dict[str, Control]
    """In the order of the settings vector."""
    conditions: tuple[Condition, ...] = ()
    """In the order of their channels, which follow the G-buffer's."""

    @property
    def card(self) -> dict[str, Any]:
        return self.weights.card

    @property
    def windows(self) -> bool:
        """Whether they have learnt from windows, and so need no more of a picture than the one around the cloud."""
        return bool(self.card.get("training", {}).get("cropped"))

    @property
    def buffer_channels(self) -> int:
        """Channels that the network reads of a cloud."""
        own = self.zbuffer.channels + self.gbuffer.channels
        return own + sum(condition.channels for condition in self.conditions)

    @property
    def settings(self) -> int:
        """Length of the settings vector."""
        return sum(control.size for control in self.controls.values())

    def build(self) -> nn.Module:
        """The torch network with these weights, in evaluation mode, float32, on the CPU."""
        import torch  # late: the other engines do without it

        from z2p_core.network.unet import build_network

        with torch.random.fork_rng(devices=[]):  # a training around us draws from torch's generator
            network = build_network(self.config, self.buffer_channels, self.encoder.channels, self.settings)
        network.load_state_dict({name: torch.from_numpy(tensor) for name, tensor in self.weights.tensors.items()})
        network.to(memory_format=torch.channels_last).eval()  # type: ignore[call-overload]
        return network


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


def load_network(weights: Weights | str | Path, *, to_train: bool = False) -> LoadedNetwork:
    """The torch network and plugins of loaded weights, of a shipped name or of a file.

    `to_train` takes other versions of the buffers' plugins as well: training gets the network used to them.

    Raises:
        WeightsError: the weights are unknown, damaged, or made with plugins of other versions.
        PluginError: a plugin that they need is not installed.
    """
    loaded = load_plugins(weights, to_train=to_train)
    network = loaded.build()
    return LoadedNetwork(network, loaded.zbuffer, loaded.gbuffer, loaded.encoder, loaded.controls, loaded.card)


def load_plugins(weights: Weights | str | Path, *, to_train: bool = False) -> LoadedWeights:
    """Loaded weights, or those of a shipped name or of a file, and the plugins of their card; see `load_network`.

    Raises:
        WeightsError: the weights are unknown, damaged, or made with plugins of other versions.
        PluginError: a plugin that they need is not installed.
    """
    if not isinstance(weights, Weights):
        weights = load_weights(find_weights(weights))
    loaded = _with_plugins(weights, to_train)
    if fault := network_config_fault(loaded.config):
        raise WeightsError(f"{_named(weights)} for a network that this z2p cannot build: {fault}")
    shapes = network_shapes(loaded.config, loaded.buffer_channels, loaded.encoder.channels, loaded.settings)
    check_tensors(weights, shapes)
    return loaded


def _with_plugins(weights: Weights, to_train: bool) -> LoadedWeights:
    """The weights with the plugins of their card, whether or not their tensors fit them."""
    card = weights.card
    zbuffer, gbuffer = (_matching(weights, f"{kind}s", card[kind], to_train)() for kind in ("zbuffer", "gbuffer"))
    encoder = _encoder(weights)
    names = [entry["name"] for entry in card["controls"]]
    if len(set(names)) < len(names):
        raise WeightsError(f"{_named(weights)} name a control twice: {', '.join(names)}; get them again")
    controls = {entry["name"]: _control(weights, entry) for entry in card["controls"]}
    try:
        config = from_dict(NetworkConfig, card["network"], "network")
    except ConfigError as error:
        raise WeightsError(f"{_named(weights)} for a network that this z2p cannot build: {error}") from error
    conditions = _conditions(weights, config, gbuffer, to_train)
    return LoadedWeights(weights, config, zbuffer, gbuffer, encoder, controls, conditions)


def _named(weights: Weights) -> str:
    return f"{weights.file}: weights" if weights.file else "weights"


def _matching(weights: Weights, group: str, entry: dict[str, Any], any_version: bool = False) -> type[Any]:
    """The plugin class of a card's entry, of the very version that the weights were trained with."""
    if entry["name"] not in registry.names(group):
        known = ", ".join(registry.names(group)) or "none"
        raise MissingPlugin(
            f"{_named(weights)} need the {group[:-1]} {entry['name']!r}, version {entry['version']}: unknown "
            f"{group[:-1]} {entry['name']!r}; installed: {known}; install the package that it came with"
        )
    plugin = registry.load(group, entry["name"])
    if plugin.version != entry["version"] and not any_version:
        raise WeightsError(
            f"{_named(weights)} need {group[:-1]} {entry['name']!r} version {entry['version']}, installed is "
            f"{plugin.version}; install that version or train again"
        )
    return plugin


def _conditions(
    weights: Weights, config: NetworkConfig, gbuffer: GBuffer, to_train: bool
) -> tuple[Condition, ...]:  # fmt: skip
    """The plugins of the card's conditions; older cards have none.

    Raises:
        WeightsError: the card lists others than its network has, or its G-buffer draws no textures.
    """
    entries = weights.card.get("conditions", [])
    names = [entry["name"] for entry in entries]
    if names != list(config.conditions) or len(set(names)) < len(names):
        raise WeightsError(f"{_named(weights)}: card.conditions: expected those of its network, "
                           f"{describe_value(list(config.conditions))}, each once, got {describe_value(names)}; get "
                           "them again")
    if names and not gbuffer.draws_textures:
        raise WeightsError(f"{_named(weights)} have conditions, but a G-buffer {gbuffer.name!r} that draws no colours; "
                           "get them again")
    return tuple(_matching(weights, "conditions", entry, to_train)() for entry in entries)


def _encoder(weights: Weights) -> PositionalEncoder:
    """The card's encoder, tried once: its state may be anything."""
    entry = weights.card["encoder"]
    plugin = _matching(weights, "encoders", entry)
    places = np.zeros((2, 2), np.float32)
    try:
        encoder: PositionalEncoder = plugin.from_state(entry["state"])
        features = encoder.encode(places, places)
        fits = features.shape == (encoder.channels, 2, 2) and bool(np.isfinite(features).all())
    except Exception as error:  # whatever a plugin stumbles over in a stranger's numbers
        raise WeightsError(f"{_named(weights)}: card.encoder.state: expected what encoder {entry['name']!r} saves, got "
                           f"{describe_value(entry['state'])} ({type(error).__name__}: {error})") from error
    if not fits or encoder.channels > MAX_ENCODER_CHANNELS:
        raise WeightsError(f"{_named(weights)}: card.encoder.state: expected what encoder {entry['name']!r} saves, got "
                           f"{describe_value(entry['state'])}")
    return encoder


def _control(weights: Weights, entry: dict[str, Any]) -> Control:
    control: Control = _matching(weights, "controls", entry)()
    if control.size != entry["size"]:
        raise WeightsError(
            f"{_named(weights)} give control {entry['name']!r} {entry['size']} settings, the installed one has "
            f"{control.size}; install the control they were trained with or train again"
        )
    return control
