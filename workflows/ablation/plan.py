"""The plan of Ablations: a FullPipeline for each variant, on shared renders and shards, and a final comparison."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from z2p_core.config import ConfigError
from z2p_core.config.ablation import AblationsConfig, Variant, parse_ablations, with_meshes
from z2p_core.registry import PluginError
from z2p_renderer.storage.configs import read_config_text
from z2p_renderer.storage.results.fingerprints import stage_fields
from z2p_renderer.storage.results.store import Entry
from z2p_renderer.workflows.plan import Plan, Step, assemble_plan, check_config, make_plan
from z2p_renderer.workflows.process.task_log import log_line

COMPARE = "compare"
VARIANT_STAGES = ("train", "evaluate")
"""Stages that are not shared: each variant has its own steps ``train/NAME`` and ``evaluate/NAME``."""


@dataclass(frozen=True)
class AblationPlan:
    """The steps of all variants, and each variant's own plan."""

    config: AblationsConfig
    steps: Mapping[str, Step]
    """All steps by name, upstream first."""
    plans: Mapping[str, Plan]
    """Name of a variant -> its plan."""
    variant_of: Mapping[str, str]
    """Name of a step -> name of a variant whose plan has it; without the comparison, which is in none."""
    command: str
    """The command line that makes these ablations; shown in the comparison."""


@lru_cache(maxsize=4)
def load_ablation_plan(source: str) -> AblationPlan:
    """Plan of an `ablation_source`; each process computes it once, so that edits during a run do not mix two plans.

    Raises:
        ConfigError: the config, or a variant of it, cannot be used.
        ScanError: a mesh folder is missing or empty.
        PluginError: the base or a variant names an unknown or broken plugin.
    """
    inputs = json.loads(source)["ablations"]
    path = Path(inputs["config"])
    config = parse_ablations(read_config_text(path), str(path))
    return make_ablation_plan(with_meshes(config, inputs["meshes"], inputs["evaluate_meshes"]), inputs["command"])


def make_ablation_plan(config: AblationsConfig, command: str = "") -> AblationPlan:
    """Plan of a config. The files in its mesh folders are read once, to compute their sha256.

    Raises: as `load_ablation_plan`.
    """
    shared = make_plan(config.base)
    for warning in shared.warnings:
        log_line(f"warning: {warning}")
    plans: dict[str, Plan] = {}
    steps: dict[str, Step] = {}
    variant_of: dict[str, str] = {}
    for variant in config.variants:
        plan = plans[variant.name] = _variant_plan(variant, shared)
        for name, step in plan.steps.items():
            steps.setdefault(name, step)
            variant_of.setdefault(name, variant.name)
    steps[COMPARE] = _comparison_step(config, plans, command)
    return AblationPlan(config, steps, plans, variant_of, command)


def _variant_plan(variant: Variant, shared: Plan) -> Plan:
    """The variant's own plan, on the base's meshes.

    Raises:
        ConfigError, PluginError: as `check_config`; the message starts with the variant's name.
    """
    try:
        check_config(variant.config)
        return _with_variant_name(assemble_plan(variant.config, shared.training, shared.evaluation), variant.name)
    except (ConfigError, PluginError) as error:
        raise type(error)(f"variants.{variant.name}: {error}") from error


def _with_variant_name(plan: Plan, variant: str) -> Plan:
    """The plan with the variant's name appended to the names of the steps that are not shared."""
    new_names = {name: f"{name}/{variant}" if name in VARIANT_STAGES else name for name in plan.steps}
    steps = [
        replace(
            step,
            entry=replace(step.entry, name=new_names[name]),
            upstream=tuple(new_names[upstream] for upstream in step.upstream),
        )
        for name, step in plan.steps.items()
    ]
    return replace(plan, steps={step.name: step for step in steps})


def _comparison_step(config: AblationsConfig, plans: Mapping[str, Plan], command: str) -> Step:
    fields = stage_fields(COMPARE) | {
        "name": config.name, "command": command,
        "variants": [_variant_fields(variant, plans[variant.name]) for variant in config.variants],
    }  # fmt: skip
    upstream = tuple(f"{stage}/{variant.name}" for stage in VARIANT_STAGES for variant in config.variants)
    return Step(Entry(COMPARE, COMPARE, fields), upstream)


def _variant_fields(variant: Variant, plan: Plan) -> dict[str, Any]:
    upstream = {stage: plan.steps[f"{stage}/{variant.name}"].entry.fingerprint for stage in VARIANT_STAGES}
    changes = {key: list(values) for key, values in variant.changes.items()}
    return {"name": variant.name, "title": variant.title, "why": variant.why, "changes": changes, **upstream}
