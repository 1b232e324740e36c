"""Loads the plan of a source (`workflows.sources`): of a pipeline, of ablations or one variant, or of a report."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

from z2p_core.config import ConfigError, PipelineConfig, from_dict, parse_config, to_dict
from z2p_core.registry import PluginError
from z2p_renderer.storage.configs import read_config_text
from z2p_renderer.workflows.ablation.plan import AblationPlan, load_ablation_plan
from z2p_renderer.workflows.plan import Plan, check_config, make_plan
from z2p_renderer.workflows.process.task_log import log_line
from z2p_renderer.workflows.report.plan import ReportPlan, load_report_plan


def load_plan(source: str) -> Plan | AblationPlan | ReportPlan:
    """Plan of any source that `workflows.sources` makes; each process computes it once.

    Raises:
        ConfigError: the config cannot be used.
        ScanError: a mesh folder is missing or empty.
        PluginError: the config names an unknown or broken plugin.
    """
    inputs = json.loads(source)
    if "report" in inputs:
        return load_report_plan(source)
    if "ablations" in inputs and "variant" not in inputs:
        return load_ablation_plan(source)
    return load_pipeline_plan(source)


@lru_cache(maxsize=8)
def load_pipeline_plan(source: str) -> Plan:
    """Plan of a `pipeline_source` or a `variant_source`.

    Each process computes it once, so that edits during a run do not mix two plans.

    Raises: as `load_plan`.
    """
    inputs = json.loads(source)
    if "variant" in inputs:
        ablations = json.dumps({"ablations": inputs["ablations"]})
        return load_ablation_plan(ablations).plans[inputs["variant"]]
    config = PipelineConfig()
    if inputs["config"]:
        path = Path(inputs["config"])
        config = parse_config(read_config_text(path), str(path))
        with _errors_with_file_name(path):
            check_config(config)
    overrides = {key: inputs[key] for key in ("meshes", "evaluate_meshes") if inputs[key]}
    plan = make_plan(from_dict(PipelineConfig, to_dict(config) | overrides))
    for warning in plan.warnings:
        log_line(f"warning: {warning}")
    return plan


@contextmanager
def _errors_with_file_name(path: Path) -> Iterator[None]:
    """Prefix the messages of errors about the config's values with the name of its file."""
    try:
        yield
    except (ConfigError, PluginError) as error:
        raise type(error)(f"{path}: {error}") from error
