"""Weights that training starts from or distils: their part of the fingerprint, and their files."""

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
    """Fields for `train`: digests of the weights, and the teacher's engine and those plugins that only it uses.

    Raises:
        ConfigError: weights that cannot be used, or that have other controls. Checked when the plan is made, so that it
            does not come up after hours of rendering.
        PluginError: a plugin of the teacher's is not installed.
    """
    fields: dict[str, Any] = {}
    for name in PRETRAINED_KEYS:
        if weights := getattr(config, name):
            loaded = _load_compatible(name, weights, controls)
            fields[name] = file_digest(find_weights(weights))
            if name == "teacher":
                plugins = _teacher_plugins(loaded, config.network)
                fields |= {"teacher_engine": _engine_fields(teacher_engine())}
                fields |= {"teacher_plugins": plugins} if plugins else {}
    return fields


def pretrained_files(config: TrainConfig, fields: Mapping[str, Any]) -> tuple[tuple[Path, str], ...]:
    """Path and sha256 of each weights file whose digest is in the `pretrained_fields`."""
    return tuple(
        (find_weights(getattr(config, name)).absolute(), fields[name]) for name in PRETRAINED_KEYS if name in fields
    )


def _load_compatible(name: str, weights: str, controls: Sequence[str]) -> Weights:
    """The weights named by ``train.<name>``, after checking that their controls are those of the config."""
    try:
        loaded = load_weights(find_weights(weights))
    except WeightsError as error:
        raise ConfigError(f"train.{name}: {error}") from error
    known = [entry["name"] for entry in loaded.card["controls"]]
    compared = len(known) if name == "start" else None  # fine-tuning may add controls after those of the weights
    if known != list(controls[:compared]):
        raise ConfigError(
            f"train.{name}: expected weights whose controls are {', '.join(controls)}, got {', '.join(known)} in "
            f"{weights}; choose others, or set render.controls as theirs"
        )
    return loaded


def _teacher_plugins(weights: Weights, network: NetworkConfig) -> list[dict[str, str]]:
    """Fields of the teacher's plugins, except those that the trained network uses too (its own fields hold these)."""
    try:
        teacher = load_plugins(weights)
    except WeightsError as error:
        raise ConfigError(f"train.teacher: {error}") from error
    shared = {registry.load(f"{kind}s", getattr(network, kind)) for kind in ("zbuffer", "gbuffer", "encoder")}
    plugins = map(type, (teacher.zbuffer, teacher.gbuffer, teacher.encoder))
    return [plugin_fields(plugin) for plugin in plugins if plugin not in shared]


def _engine_fields(name: str | None) -> dict[str, str]:
    """Identity of the teacher's engine. All exact engines (None) count as one: they differ in rounding only."""
    if name is None:
        return {"name": "exact"}
    engine = registry.load("engines", name)
    return {"name": name, "version": engine.version, engine.package: installed_version(engine.package)}
