"""Makes the plan of a source: of a pipeline, of ablations or one of their variants, or of a report."""

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
    """Plan of any source that `workflows.sources` makes; made once a process.

    Raises:
        ConfigError: the config cannot be used.
        ScanError: a mesh folder is missing or empty.
        PluginError: the config names an unknown or broken plugin.
    """
    where = json.loads(source)
    if "report" in where:
        return load_report_plan(source)
    if "ablations" in where and "variant" not in where:
        return load_ablation_plan(source)
    return load_pipeline_plan(source)


@lru_cache(maxsize=8)
def load_pipeline_plan(source: str) -> Plan:
    """Plan of a `pipeline_source` or a `variant_source`.

    It is made once a process, so that edits during a run do not mix two plans.

    Raises: as `load_plan`.
    """
    where = json.loads(source)
    if "variant" in where:
        ablations = json.dumps({"ablations": where["ablations"]})
        return load_ablation_plan(ablations).plans[where["variant"]]
    config = PipelineConfig()
    if where["config"]:
        path = Path(where["config"])
        config = parse_config(read_config_text(path), str(path))
        with _errors_name_file(path):
            check_config(config)
    given = {key: where[key] for key in ("meshes", "evaluate_meshes") if where[key]}
    plan = make_plan(from_dict(PipelineConfig, to_dict(config) | given))
    for warning in plan.warnings:
        log_line(f"warning: {warning}")
    return plan


@contextmanager
def _errors_name_file(path: Path) -> Iterator[None]:
    """Puts the name of the config's file before errors about its values."""
    try:
        yield
    except (ConfigError, PluginError) as error:
        raise type(error)(f"{path}: {error}") from error
