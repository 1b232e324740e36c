"""Weights made ready to draw: the plugins that their card names, and the network in the form that its engine takes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from z2p_core import registry
from z2p_core.config import ConfigError, NetworkConfig, from_dict
from z2p_core.interfaces import Control, GBuffer, PositionalEncoder, ZBuffer
from z2p_renderer.storage.checkpoints import Weights, WeightsError, check, load_weights, resolve

if TYPE_CHECKING:
    from torch import nn


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
        return self.zbuffer.channels + self.gbuffer.channels

    @property
    def settings(self) -> int:
        """Length of the settings vector."""
        return sum(control.size for control in self.controls.values())

    def build(self) -> nn.Module:
        """The torch network with these weights, in evaluation mode, float32, on the CPU.

        Raises:
            WeightsError: the weights do not fit the network of their card.
        """
        import torch  # late: the other engines do without it

        from z2p_core.model import build_network

        try:
            with torch.random.fork_rng(devices=[]):  # a training around us draws from torch's generator
                network = build_network(self.config, self.buffer_channels, self.encoder.channels, self.settings)
        except ValueError as error:
            raise WeightsError(f"weights for a network that this z2p cannot build: {error}") from error
        check(self.weights, {name: tuple(tensor.shape) for name, tensor in network.state_dict().items()})
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
        weights = load_weights(resolve(weights))
    card = weights.card
    zbuffer, gbuffer = (_matching(f"{kind}s", card[kind], to_train)() for kind in ("zbuffer", "gbuffer"))
    encoder = _matching("encoders", card["encoder"]).from_state(card["encoder"]["state"])
    controls = {entry["name"]: _control(entry) for entry in card["controls"]}
    try:
        config = from_dict(NetworkConfig, card["network"], "weights: network")
    except ConfigError as error:
        raise WeightsError(f"weights for a network that this z2p cannot build: {error}") from error
    return LoadedWeights(weights, config, zbuffer, gbuffer, encoder, controls)


def _matching(group: str, entry: dict[str, Any], any_version: bool = False) -> type[Any]:
    """The plugin class of a card's entry, of the very version that the weights were trained with."""
    plugin = registry.load(group, entry["name"])
    if plugin.version != entry["version"] and not any_version:
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
