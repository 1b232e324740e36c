"""The configuration of ablations: a base, and variants of its training with the same budget.

A TOML file holds the pipeline's keys for the base, and a table for each variant:

    [variants.no-ssim]
    title = "no SSIM in the loss"
    why = "whether likeness of structure earns its time"
    train.loss.ssim = 0.0

Variants change `train` alone, and neither its steps nor its batch; renders, shards and evaluation are shared.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from z2p_core.config.pipeline import ConfigError, PipelineConfig, TrainConfig, from_dict, to_dict, toml_tables

BASE = "base"
"""Name of the base among the variants."""
BUDGET_KEYS = ("steps", "batch", "resolutions")
"""Keys of `train` that determine the number of samples, which variants must not change."""


@dataclass(frozen=True)
class Variant:
    """One training run of the ablations."""

    name: str
    title: str
    why: str
    config: PipelineConfig
    """The complete configuration, with the base's values."""
    changes: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)
    """Key below `train` -> the base's value and its own; empty for the base."""

    @property
    def is_repeat(self) -> bool:
        """Whether it differs from the base in the seed alone, which measures random variation."""
        return set(self.changes) == {"seed"}


@dataclass(frozen=True)
class AblationsConfig:
    """The base and its variants, the base first."""

    base: PipelineConfig
    variants: tuple[Variant, ...]

    @property
    def name(self) -> str:
        """Name under which the results are stored."""
        return self.base.name


def parse_ablations(text: str, source: str = "config") -> AblationsConfig:
    """AblationsConfig of a TOML text; keys that the base lacks keep their defaults.

    Raises:
        ConfigError: not TOML, no variants, an unknown key, a value of the wrong type, or an invalid variant.
    """
    data = toml_tables(text, source)
    tables = data.pop("variants", {})
    if not isinstance(tables, dict) or not tables:
        raise ConfigError(f"{source}: expected one or more tables [variants.NAME]")
    base: PipelineConfig = from_dict(PipelineConfig, data, source)
    variants = [_variant(name, table, base, f"{source}: variants.{name}") for name, table in tables.items()]
    return AblationsConfig(base, (Variant(BASE, "the base", "what the others are compared with", base), *variants))


def with_meshes(config: AblationsConfig, meshes: str, evaluate_meshes: str) -> AblationsConfig:
    """The same ablations on other folders of meshes; an empty path keeps the config's folder."""

    def on_meshes(one: PipelineConfig) -> PipelineConfig:
        return replace(one, meshes=meshes or one.meshes, evaluate_meshes=evaluate_meshes or one.evaluate_meshes)

    variants = tuple(replace(one, config=on_meshes(one.config)) for one in config.variants)
    return AblationsConfig(on_meshes(config.base), variants)


def _variant(name: str, table: Any, base: PipelineConfig, where: str) -> Variant:
    if name == BASE or not re.fullmatch(r"[\w.-]+", name):
        raise ConfigError(f"{where}: expected a name of letters, digits, '-', '_' and '.' other than {BASE!r}")
    if not isinstance(table, dict):
        raise ConfigError(f"{where}: expected a table, got {table!r}")
    for key in sorted(set(table) - {"title", "why", "train"}):
        raise ConfigError(f"{where}: unknown key {key!r}; known: title, why, train (a variant changes that alone)")
    for key in ("title", "why"):
        if not isinstance(table.get(key), str) or not table[key]:
            raise ConfigError(f"{where}: {key}: expected a line of text, got {table.get(key)!r}")
    train = _changed(base.train, table.get("train", {}), f"{where}: train")
    before, after = (_leaves(to_dict(one)) for one in (base.train, train))
    changes = {key: (before[key], after[key]) for key in before if before[key] != after[key]}
    if not changes:
        raise ConfigError(f"{where}: expected a value of train.* that differs from the base's")
    for key in sorted(set(changes) & set(BUDGET_KEYS)):
        raise ConfigError(f"{where}: train.{key}: expected the base's, as all variants have the same budget")
    return Variant(name, table["title"], table["why"], replace(base, train=train), changes)


def _changed(base: TrainConfig, changes: Any, where: str) -> TrainConfig:
    """The base's training with the values of a variant's table."""
    if not isinstance(changes, dict):
        raise ConfigError(f"{where}: expected a table, got {changes!r}")
    from_dict(TrainConfig, changes, where)  # raises errors with the keys of the file
    train: TrainConfig = from_dict(TrainConfig, _merged(to_dict(base), changes), where)
    return train


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    deeper = {key: _merged(base[key], value) for key, value in changes.items() if isinstance(value, dict)}
    return {**base, **changes, **deeper}


def _leaves(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested values by their dotted keys."""
    leaves: dict[str, Any] = {}
    for key, value in values.items():
        leaves |= _leaves(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return leaves
