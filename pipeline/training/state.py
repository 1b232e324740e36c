"""What a training run holds, how it starts, and how a checkpoint carries all of it over a kill."""

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
from z2p_renderer.storage.models.checkpoints import load_checkpoint, find_weights
from z2p_renderer.storage.results.fingerprints import file_digest

ADAM_BETAS = (0.9, 0.99)
WEIGHT_DECAY = 0.01
ENCODER_SEED = 4
"""Beside the seeds of `pipeline.training.dataset`."""
SETTINGS_LAYER = "mapping.layers.0.weight"
"""The only tensor (M, S) whose shape depends on the controls."""


class TrainError(RuntimeError):
    """Training that cannot start or go on; the message says why and what to do."""


@dataclass
class TrainingState:
    """All that a training run carries from step to step."""

    config: TrainConfig
    data: CloudDataset
    fixed_elevation: float | None
    encoder: PositionalEncoder
    network: nn.Module
    average: nn.Module
    """Exponential moving average of the network: what is validated and shipped."""
    optimizer: torch.optim.Optimizer
    encodings: dict[int, Tensor]
    """Side of the picture -> positional encoding (E, side/u, side/u)."""
    device: torch.device
    precision: str
    step: int = 0
    rows: list[Row] = field(default_factory=list)
    recent: list[Row] = field(default_factory=list)
    """Losses since the last row of the curve."""


def start_training(shards: Sequence[Path], config: TrainConfig, device: torch.device, precision: str) -> TrainingState:
    """A run at step 0, its network drawn from torch's generator, its encoder from the config's seed.

    Raises:
        ShardError, DatasetError, PluginError, ValueError: shards, plugins or config that cannot be used.
        WeightsError, TrainError: the weights to start from cannot be used, or are of another network.
    """
    if precision not in ("auto", "float32", "bfloat16"):
        raise ValueError(f"precision: expected auto, float32 or bfloat16, got {precision!r}")
    for name in ("steps", "batch", "validate_every", "checkpoint_every"):
        if getattr(config, name) < 1:
            raise ValueError(f"train: {name}: expected 1 or more, got {getattr(config, name)}")
    zbuffer, gbuffer = (registry.load(f"{kind}s", getattr(config.network, kind))() for kind in ("zbuffer", "gbuffer"))
    data = CloudDataset(shards, config, zbuffer, gbuffer)
    start = load_network(config.start, to_train=True) if config.start else None
    if start:
        encoder = start.encoder
    else:
        rng = np.random.default_rng((ENCODER_SEED, config.seed))
        encoder = registry.load("encoders", config.network.encoder).create(rng)
    cells = {side: Camera(side, side).frame_coordinates(config.network.unshuffle) for side in data.sides}
    encodings = {side: torch.from_numpy(encoder.encode(u, v)).to(device) for side, (u, v) in cells.items()}
    network = build_network(config.network, zbuffer.channels + gbuffer.channels, encoder.channels, data.settings)
    if start:
        _check_start_weights(start.card, config, data)
        network.load_state_dict(_add_control_columns(start.network.state_dict(), network.state_dict()))
    network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    average = copy.deepcopy(network).eval().requires_grad_(False)
    optimizer = torch.optim.AdamW(network.parameters(), betas=ADAM_BETAS, weight_decay=WEIGHT_DECAY, fused=True)
    chosen = fastest_precision(device) if precision == "auto" else precision
    return TrainingState(config, data, data.fixed_elevation, encoder, network, average, optimizer, encodings, device, chosen)


def _check_start_weights(card: dict[str, Any], config: TrainConfig, data: CloudDataset) -> None:
    """
    Raises:
        TrainError: weights with that card cannot be fine-tuned by this config on these shards.
    """
    network = from_dict(NetworkConfig, card["network"])
    wanted_network = config.network
    if registry.load("gbuffers", wanted_network.gbuffer).refines == network.gbuffer:
        wanted_network = replace(wanted_network, gbuffer=network.gbuffer)
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
    """The tensors of weights to start from, with a fresh column for each control that they lack.

    The new columns begin at nothing, so that the network draws as before at first, whatever these controls say.
    """
    if SETTINGS_LAYER not in known:  # settings as input channels: further ones would be another network's
        return dict(known)
    columns = known[SETTINGS_LAYER]
    new = columns.new_zeros(len(columns), fresh[SETTINGS_LAYER].shape[1] - columns.shape[1])
    return {**known, SETTINGS_LAYER: torch.cat([columns, new], dim=1)}


def weights_card(run: TrainingState) -> dict[str, Any]:
    """The card that goes with the weights; see `z2p_renderer.storage.models.checkpoints.Weights`."""
    training = {**_config_shaping_weights(run.config), "renders": len(run.data.training), "meshes": len(run.data.shards)}
    for name in ("start", "teacher"):  # a path would tell of the machine, and mean nothing on others
        training[name] = Path(training[name]).stem
    return {
        "network": to_dict(run.config.network),
        **_plugin_cards(run),
        "resolution": list(run.data.sides),
        "fixed_elevation": run.fixed_elevation,
        "training": training,
    }


def checkpoint_content(run: TrainingState) -> tuple[dict[str, Any], dict[str, Any]]:
    """Tensors and state of a checkpoint. The data order needs no more than the step: see `CloudPictures.batch`."""
    tensors: dict[str, Any] = {"random": torch.get_rng_state()}
    for name, module in (("network", run.network), ("average", run.average)):
        tensors |= {f"{name}/{key}": value for key, value in module.state_dict().items()}
    for index, state in run.optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer/{index}/{key}": value for key, value in state.items()}
    state = {"step": run.step, "precision": run.precision, "rows": run.rows, "recent": run.recent}
    return tensors, {"identity": _run_identity(run), **state}


def resume_from_checkpoint(run: TrainingState, out: Path, log: Callable[[str], object]) -> None:
    """Takes up the newest sound checkpoint in `out`, if there is one.

    Raises:
        TrainError: it belongs to another run.
    """
    found = load_checkpoint(out / "checkpoints")
    if found is None:
        return
    arrays, state, warnings = found
    for warning in warnings:
        log(f"warning: {warning}")
    if not state:
        return
    if state["identity"] != _run_identity(run):
        raise TrainError(f"{out} holds a checkpoint of another config or other shards; delete it or train elsewhere")
    tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
    torch.set_rng_state(tensors["random"])
    for name, module in (("network", run.network), ("average", run.average)):
        module.load_state_dict({key: tensors[f"{name}/{key}"] for key in module.state_dict()})
    _restore_optimizer(run, tensors)
    run.step, run.precision = state["step"], state["precision"]
    run.rows, run.recent = state["rows"], state["recent"]
    log(f"going on from step {run.step}")


def fastest_precision(device: torch.device) -> str:
    """``bfloat16`` on a GPU and on a CPU with instructions for it, else ``float32``: told by the device, not timed."""
    if device.type != "cpu" or torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported():
        return "bfloat16"
    return "float32"


def _run_identity(run: TrainingState) -> dict[str, Any]:
    """What a checkpoint and a run must share to be one run."""
    shards = [[shard.attributes["mesh"], len(shard)] for shard in run.data.shards]
    config = _config_shaping_weights(run.config)
    for name in ("start", "teacher"):  # the same file may lie elsewhere by now
        config[name] = config[name] and file_digest(find_weights(config[name]))
    return {"config": config, "shards": shards, "resolution": run.data.resolution, **_plugin_cards(run)}


def _config_shaping_weights(config: TrainConfig) -> dict[str, Any]:
    """The config without what shapes no weight: a run resumes exactly, so how often it could does not matter."""
    return {name: value for name, value in to_dict(config).items() if name != "checkpoint_every"}


def _plugin_cards(run: TrainingState) -> dict[str, Any]:
    """The plugins whose work the weights expect, as the card lists them."""
    network, encoder = run.config.network, run.encoder
    return {
        "zbuffer": {"name": network.zbuffer, "version": run.data.zbuffer.version},
        "gbuffer": {"name": network.gbuffer, "version": run.data.gbuffer.version},
        "encoder": {"name": network.encoder, "version": encoder.version, "state": encoder.state},
        "controls": [{key: control[key] for key in ("name", "version", "size")} for control in run.data.controls],
    }


def _restore_optimizer(run: TrainingState, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for index, parameter in enumerate(run.network.parameters()):
        prefix = f"optimizer/{index}/"
        state[index] = {name.removeprefix(prefix): x for name, x in tensors.items() if name.startswith(prefix)}
        for key, tensor in state[index].items():
            if tensor.shape == parameter.shape and tensor.ndim:
                # the fused optimiser reads memory in order: it must lie as the parameter does
                state[index][key] = torch.empty_like(parameter).copy_(tensor)
    groups = run.optimizer.state_dict()["param_groups"]
    run.optimizer.load_state_dict({"state": state, "param_groups": groups})
