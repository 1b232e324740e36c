"""Plan sources: where the inputs of a plan come from, as one JSON string that is handed to other processes.

A luigi task carries such a string, and each process makes the plan from it again (`workflows.plan_loading`). All paths
in it are absolute. Its keys tell the kind of the plan: ``report``, ``ablations`` (with ``variant`` for the plan of one
variant alone), else a pipeline's.
"""

from __future__ import annotations

import json
import tomllib
from contextlib import suppress
from pathlib import Path

from z2p_core.config import ConfigError, parse_config
from z2p_core.config.report import parse_report
from z2p_renderer.storage.configs import read_config_text

DEFAULT_ABLATIONS = Path(__file__).parents[1] / "configs" / "ablations.toml"


def pipeline_source(config: str, meshes: str, evaluate_meshes: str) -> str:
    """Source of a FullPipeline's plan. An empty config means the default one; empty meshes, those of the config."""
    where = {"config": config, "meshes": meshes, "evaluate_meshes": evaluate_meshes}
    return json.dumps({key: absolute_path(value) for key, value in where.items()})


def ablation_source(config: str, meshes: str, evaluate_meshes: str) -> str:
    """Source of the plan of Ablations, with the command that makes the same."""
    options = {"config": config, "meshes": meshes, "evaluate-meshes": evaluate_meshes}
    where = {name.replace("-", "_"): absolute_path(value) for name, value in options.items()}
    where["config"] = where["config"] or str(DEFAULT_ABLATIONS)
    return json.dumps({"ablations": {**where, "command": _command("z2p ablate", options)}})


def variant_source(source: str, variant: str) -> str:
    """Source of the plan of one variant, from that of its ablations."""
    return json.dumps({**json.loads(source), "variant": variant})


def report_source(config: str, meshes: str, scans: str, weights: str, sweeps: str) -> str:
    """Source of a PaperReport's plan, with the command that makes the same.

    `weights` and `sweeps` are comma-separated names; weights may be files.
    """
    options = {"config": config, "meshes": meshes, "scans": scans, "weights": weights, "sweeps": sweeps}
    where = {name: absolute_path(options[name]) for name in ("config", "meshes", "scans")}
    files = [absolute_path(name) if Path(name).is_file() else name for name in split_names(weights)]
    where |= {"weights": ",".join(files), "sweeps": sweeps}
    return json.dumps({"report": {**where, "command": _command("z2p report-paper", options)}})


def is_ablation_config(config: str) -> bool:
    """Whether a TOML file holds variants, whether or not the rest of it is valid."""
    try:
        return "variants" in tomllib.loads(Path(config).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # reading it as a pipeline's config reports the error
        return False


def is_report_config(config: str) -> bool:
    """Whether a TOML file holds the settings of a report, and cannot be read as those of a pipeline."""
    try:
        text = read_config_text(Path(config))
    except ConfigError:  # reading it as a pipeline's config reports the error
        return False
    try:
        parse_config(text)
    except ConfigError:
        with suppress(ConfigError):
            parse_report(text)
            return True
    return False


def absolute_path(path: str) -> str:
    """The path from the root; an empty one and ``builtin`` stay as they are."""
    return path if path in ("", "builtin") else str(Path(path).absolute())


def split_names(text: str) -> list[str]:
    """Names of a comma-separated list."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _command(program: str, options: dict[str, str]) -> str:
    return " ".join([program, *(f"--{name} {value}" for name, value in options.items() if value)])
