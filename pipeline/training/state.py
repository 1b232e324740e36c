"""The state of a training run: how it starts, and how checkpoints save and restore it exactly."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.config import NetworkConfig, TrainConfig, from_dict, to_dict
from z2p_core.interfaces import PositionalEncoder
from z2p_core.network.unet import build_network
from z2p_renderer.pipeline.inference.loading import load_network
from z2p_renderer.pipeline.training.dataset import CloudDataset
from z2p_renderer.pipeline.training.learning_curve import Row
from z2p_renderer.storage.models.checkpoints import find_weights, load_checkpoint
from z2p_renderer.storage.results.fingerprints import file_digest

ADAM_BETAS = (0.9, 0.99)
WEIGHT_DECAY = 0.01
ENCODER_SEED = 4
"""First word of the encoder's seed; differs from those in `pipeline.training.dataset`."""
CONVOLUTION_DIMENSIONS = 4
"""Dimensions of a convolution's weights: outputs, inputs, height, width."""
SETTINGS_LAYER = "mapping.layers.0.weight"
"""State-dict key of the only tensor, (M, S), whose shape depends on the controls."""


class TrainError(RuntimeError):
    """Training cannot start or continue; the message says why and what to do."""


@dataclass
class TrainingState:
    """Everything that a training run carries from step to step."""

    config: TrainConfig
    data: CloudDataset
    fixed_elevation: float | None
    encoder: PositionalEncoder
    network: nn.Module
    average: nn.Module
    """Exponential moving average of the network's weights; it is what is validated and shipped."""
    optimizer: torch.optim.Optimizer
    encodings: dict[int, Tensor]
    """Image side -> positional encoding (E, side/u, side/u), u the network's `unshuffle`."""
    device: torch.device
    precision: str
    step: int = 0
    rows: list[Row] = field(default_factory=list)
    """The learning curve so far."""
    recent_losses: list[Row] = field(default_factory=list)
    """Losses of the steps since the last row of the curve."""


def start_training(shards: Sequence[Path], config: TrainConfig, device: torch.device, precision: str) -> TrainingState:
    """State at step 0: network weights from torch's generator, the encoder from the config's seed.

    Raises:
        ShardError, DatasetError, PluginError, ValueError: shards, plugins or the config cannot be used.
        WeightsError, TrainError: the weights to start from cannot be used, or belong to another network.
    """
    if precision not in ("auto", "float32", "bfloat16"):
        raise ValueError(f"precision: expected auto, float32 or bfloat16, got {precision!r}")
    for name in ("steps", "batch", "validate_every", "checkpoint_every"):
        if getattr(config, name) < 1:
            raise ValueError(f"train: {name}: expected 1 or more, got {getattr(config, name)}")
    zbuffer, gbuffer = (registry.load(f"{kind}s", getattr(config.network, kind))() for kind in ("zbuffer", "gbuffer"))
    conditions = [registry.load("conditions", name)() for name in config.network.conditions]
    data = CloudDataset(shards, config, zbuffer, gbuffer, conditions)
    start_weights = load_network(config.start, to_train=True) if config.start else None
    if start_weights:
        encoder = start_weights.encoder
    else:
        rng = np.random.default_rng((ENCODER_SEED, config.seed))
        encoder = registry.load("encoders", config.network.encoder).create(rng)
    cells = {side: Camera(side, side).frame_coordinates(config.network.unshuffle) for side in data.sides}
    encodings = {side: torch.from_numpy(encoder.encode(u, v)).to(device) for side, (u, v) in cells.items()}
    channels = zbuffer.channels + gbuffer.channels
    extra = sum(condition.channels for condition in conditions)
    network = build_network(config.network, channels + extra, encoder.channels, data.settings)
    if start_weights:
        _check_start_weights(start_weights.card, config, data)
        own = start_weights.card.get("conditions", [])
        start_channels = channels + sum(condition.channels for condition in conditions[: len(own)])
        known = _add_control_columns(start_weights.network.state_dict(), network.state_dict())
        network.load_state_dict(_add_condition_inputs(known, network.state_dict(), config.network, start_channels))
    network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    average = copy.deepcopy(network).eval().requires_grad_(False)
    optimizer = torch.optim.AdamW(network.parameters(), betas=ADAM_BETAS, weight_decay=WEIGHT_DECAY, fused=True)
    precision = fastest_precision(device) if precision == "auto" else precision
    return TrainingState(
        config, data, data.fixed_elevation, encoder, network, average, optimizer, encodings, device, precision
    )


def _check_start_weights(card: dict[str, Any], config: TrainConfig, data: CloudDataset) -> None:
    """
    Raises:
        TrainError: weights with that card cannot be fine-tuned by this config on these shards.
    """
    network = from_dict(NetworkConfig, card["network"])
    wanted_network = config.network
    if registry.load("gbuffers", wanted_network.gbuffer).refines == network.gbuffer:
        wanted_network = replace(wanted_network, gbuffer=network.gbuffer)
    # further conditions are learnt
    wanted_network = replace(wanted_network, conditions=wanted_network.conditions[: len(network.conditions)])
    known = [[entry["name"], entry["version"]] for entry in card["controls"]]
    controls = [[control["name"], control["version"]] for control in data.controls]
    pairs = {
        "network": (to_dict(wanted_network), to_dict(network)),
        "controls": (controls[: len(known)], known),  # further ones are learnt
    }
    for part, (wanted, came) in pairs.items():
        if came != wanted:
            raise TrainError(
                f"train.start: expected weights whose {part} is {wanted}, got {came} in {config.start}; "
                "start from others, or set the config as theirs"
            )


def _add_control_columns(known: Mapping[str, Tensor], fresh: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The tensors of the weights to start from, with a new column for each control that they lack.

    New columns are 0, so that the network at first ignores the new controls.
    """
    if SETTINGS_LAYER not in known:  # settings as input channels: more of them would need another network
        return dict(known)
    columns = known[SETTINGS_LAYER]
    new = columns.new_zeros(len(columns), fresh[SETTINGS_LAYER].shape[1] - columns.shape[1])
    return {**known, SETTINGS_LAYER: torch.cat([columns, new], dim=1)}


def _add_condition_inputs(
    known: Mapping[str, Tensor], fresh: Mapping[str, Tensor], config: NetworkConfig, channels: int
) -> dict[str, Tensor]:
    """The tensors of the weights to start from, with new inputs for each condition that they lack, of weight 0.

    `channels` are those of the buffers that they read. New ones follow these, and come before the encoding.
    """
    first_new = {"stem.weight": channels * config.unshuffle**2, "encode.0.first.weight": channels}
    widened = dict(known)
    for name, tensor in known.items():
        missing = fresh[name].shape[1] - tensor.shape[1] if tensor.ndim == CONVOLUTION_DIMENSIONS else 0
        if missing > 0:
            before, after = tensor.tensor_split([first_new.get(name, tensor.shape[1])], dim=1)
            new = tensor.new_zeros(len(tensor), missing, *tensor.shape[2:])
            widened[name] = torch.cat([before, new, after], dim=1)
    return widened


def weights_card(state: TrainingState) -> dict[str, Any]:
    """The card stored with the weights; see `z2p_renderer.storage.models.checkpoints.Weights`."""
    data = state.data
    training = {**_config_shaping_weights(state.config), "renders": len(data.training), "meshes": len(data.shards)}
    for name in ("start", "teacher"):  # a path would mean nothing on another machine
        training[name] = Path(training[name]).stem
    return {
        "network": to_dict(state.config.network),
        **_plugin_cards(state),
        "resolution": list(state.data.sides),
        "fixed_elevation": state.fixed_elevation,
        "training": training,
    }


def checkpoint_content(state: TrainingState) -> tuple[dict[str, Any], dict[str, Any]]:
    """Tensors and state of a checkpoint. The data order needs no more than the step: see `CloudPictures.batch`."""
    tensors: dict[str, Any] = {"random": torch.get_rng_state()}
    for name, module in (("network", state.network), ("average", state.average)):
        tensors |= {f"{name}/{key}": value for key, value in module.state_dict().items()}
    for index, moments in state.optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer/{index}/{key}": value for key, value in moments.items()}
    progress = {"step": state.step, "precision": state.precision, "rows": state.rows, "recent": state.recent_losses}
    return tensors, {"identity": _run_identity(state), **progress}


def resume_from_checkpoint(state: TrainingState, out: Path, log: Callable[[str], object]) -> None:
    """Restores the newest sound checkpoint in `out`, if there is one.

    Raises:
        TrainError: it belongs to another state.
    """
    checkpoint = load_checkpoint(out / "checkpoints")
    if checkpoint is None:
        return
    arrays, saved, warnings = checkpoint
    for warning in warnings:
        log(f"warning: {warning}")
    if not saved:
        return
    if saved["identity"] != _run_identity(state):
        raise TrainError(f"{out} holds a checkpoint of another config or other shards; delete it or train elsewhere")
    tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
    torch.set_rng_state(tensors["random"])
    for name, module in (("network", state.network), ("average", state.average)):
        module.load_state_dict({key: tensors[f"{name}/{key}"] for key in module.state_dict()})
    _restore_optimizer(state, tensors)
    state.step, state.precision = saved["step"], saved["precision"]
    state.rows, state.recent_losses = saved["rows"], saved["recent"]
    log(f"going on from step {state.step}")


def fastest_precision(device: torch.device) -> str:
    """``bfloat16`` on a GPU and on a CPU with instructions for it, else ``float32``; nothing is timed."""
    if device.type != "cpu" or torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported():
        return "bfloat16"
    return "float32"


def _run_identity(state: TrainingState) -> dict[str, Any]:
    """What a checkpoint and a run must have in common for the run to resume from it."""
    shards = [[shard.attributes["mesh"], len(shard)] for shard in state.data.shards]
    config = _config_shaping_weights(state.config)
    for name in ("start", "teacher"):  # the same file may have been moved
        config[name] = config[name] and file_digest(find_weights(config[name]))
    return {"config": config, "shards": shards, "resolution": state.data.resolution, **_plugin_cards(state)}


def _config_shaping_weights(config: TrainConfig) -> dict[str, Any]:
    """The config without `checkpoint_every`: a run resumes exactly, so the interval does not affect the weights."""
    return {name: value for name, value in to_dict(config).items() if name != "checkpoint_every"}


def _plugin_cards(state: TrainingState) -> dict[str, Any]:
    """The plugins that the weights need, as the card lists them."""
    network, encoder = state.config.network, state.encoder
    conditions = [{"name": condition.name, "version": condition.version} for condition in state.data.conditions]
    return {
        **({"conditions": conditions} if conditions else {}),
        "zbuffer": {"name": network.zbuffer, "version": state.data.zbuffer.version},
        "gbuffer": {"name": network.gbuffer, "version": state.data.gbuffer.version},
        "encoder": {"name": network.encoder, "version": encoder.version, "state": encoder.state},
        "controls": [{key: control[key] for key in ("name", "version", "size")} for control in state.data.controls],
    }


def _restore_optimizer(state: TrainingState, tensors: dict[str, Tensor]) -> None:
    moments: dict[int, dict[str, Tensor]] = {}
    for index, parameter in enumerate(state.network.parameters()):
        prefix = f"optimizer/{index}/"
        moments[index] = {name.removeprefix(prefix): x for name, x in tensors.items() if name.startswith(prefix)}
        for key, tensor in moments[index].items():
            if tensor.shape == parameter.shape and tensor.ndim:
                # the fused optimiser needs the parameter's own memory layout
                moments[index][key] = torch.empty_like(parameter).copy_(tensor)
    groups = state.optimizer.state_dict()["param_groups"]
    state.optimizer.load_state_dict({"state": moments, "param_groups": groups})
