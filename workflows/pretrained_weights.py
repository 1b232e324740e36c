"""The weights that a training starts or learns from: what of them is in its fingerprint, and which files they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from z2p_core import registry
from z2p_core.config import ConfigError, NetworkConfig, TrainConfig
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.pipeline.training.distillation import teacher_engine
from z2p_renderer.storage.models.checkpoints import Weights, WeightsError, find_weights, load_weights
from z2p_renderer.storage.results.fingerprints import file_digest, plugin_fields
from z2p_renderer.storage.results.stage_dependencies import installed_version

PRETRAINED_KEYS = ("start", "teacher")
"""Keys of `train` that name weights."""


def pretrained_fields(config: TrainConfig, controls: Sequence[str]) -> dict[str, Any]:
    """The weights' digests, and what draws the teacher's pictures: its engine, and plugins that are its alone.

    Raises:
        ConfigError: weights that cannot be used, or of other controls: told now, not after hours of rendering.
        PluginError: a plugin of the teacher's is not installed.
    """
    fields: dict[str, Any] = {}
    for name in PRETRAINED_KEYS:
        if weights := getattr(config, name):
            loaded = _load_matching(name, weights, controls)
            fields[name] = file_digest(find_weights(weights))
            if name == "teacher":
                plugins = _teacher_plugins(loaded, config.network)
                fields |= {"teacher_engine": _engine_fields(teacher_engine())}
                fields |= {"teacher_plugins": plugins} if plugins else {}
    return fields


def pretrained_files(config: TrainConfig, fields: Mapping[str, Any]) -> tuple[tuple[Path, str], ...]:
    """File and digest of each of the weights that `pretrained_fields` tell of."""
    return tuple((find_weights(getattr(config, name)).absolute(), fields[name]) for name in PRETRAINED_KEYS if name in fields)


def _load_matching(name: str, weights: str, controls: Sequence[str]) -> Weights:
    try:
        found = load_weights(find_weights(weights))
    except WeightsError as error:
        raise ConfigError(f"train.{name}: {error}") from error
    known = [entry["name"] for entry in found.card["controls"]]
    learnt = len(known) if name == "start" else None  # what comes after is new to weights that are started from
    if known != list(controls[:learnt]):
        raise ConfigError(
            f"train.{name}: expected weights whose controls are {', '.join(controls)}, got {', '.join(known)} in "
            f"{weights}; choose others, or set render.controls as theirs"
        )
    return found


def _teacher_plugins(weights: Weights, network: NetworkConfig) -> list[dict[str, str]]:
    """Plugins that draw for the teacher; those that the network in training has as well are told with it."""
    try:
        teacher = load_plugins(weights)
    except WeightsError as error:
        raise ConfigError(f"train.teacher: {error}") from error
    shared = {registry.load(f"{kind}s", getattr(network, kind)) for kind in ("zbuffer", "gbuffer", "encoder")}
    plugins = map(type, (teacher.zbuffer, teacher.gbuffer, teacher.encoder))
    return [plugin_fields(plugin) for plugin in plugins if plugin not in shared]


def _engine_fields(name: str | None) -> dict[str, str]:
    """What tells an engine from another; exact ones give the same picture but for rounding."""
    if name is None:
        return {"name": "exact"}
    engine = registry.load("engines", name)
    return {"name": name, "version": engine.version, engine.package: installed_version(engine.package)}
