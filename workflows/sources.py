"""Plan sources: the names of a plan's inputs as one JSON string, which can be passed to other processes.

Each luigi task has such a string as a parameter, and each process computes the plan from it again
(`workflows.plan_loading`). All paths in it are absolute. The keys say which kind of plan it is: ``report`` for a
report, ``ablations`` for ablations (together with ``variant`` for the plan of one variant), otherwise a pipeline.
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
    """Source of a FullPipeline's plan. An empty config means the default one, empty meshes those of the config."""
    inputs = {"config": config, "meshes": meshes, "evaluate_meshes": evaluate_meshes}
    return json.dumps({key: absolute_path(value) for key, value in inputs.items()})


def ablation_source(config: str, meshes: str, evaluate_meshes: str) -> str:
    """Source of the plan of Ablations; it includes the command line that makes the same ablations."""
    options = {"config": config, "meshes": meshes, "evaluate-meshes": evaluate_meshes}
    inputs = {name.replace("-", "_"): absolute_path(value) for name, value in options.items()}
    inputs["config"] = inputs["config"] or str(DEFAULT_ABLATIONS)
    return json.dumps({"ablations": {**inputs, "command": _command("z2p ablate", options)}})


def variant_source(source: str, variant: str) -> str:
    """Source of the plan of one variant, made from the source of its ablations."""
    return json.dumps({**json.loads(source), "variant": variant})


def report_source(config: str, meshes: str, scans: str, weights: str, sweeps: str) -> str:
    """Source of a PaperReport's plan; it includes the command line that makes the same report.

    `weights` and `sweeps` are comma-separated names; weights may be files.
    """
    options = {"config": config, "meshes": meshes, "scans": scans, "weights": weights, "sweeps": sweeps}
    inputs = {name: absolute_path(options[name]) for name in ("config", "meshes", "scans")}
    files = [absolute_path(name) if Path(name).is_file() else name for name in split_names(weights)]
    inputs |= {"weights": ",".join(files), "sweeps": sweeps}
    return json.dumps({"report": {**inputs, "command": _command("z2p report-paper", options)}})


def is_ablation_config(config: str) -> bool:
    """Whether a TOML file has a table of variants; the rest of it need not be valid."""
    try:
        return "variants" in tomllib.loads(Path(config).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # reading it as a pipeline's config reports the error
        return False


def is_report_config(config: str) -> bool:
    """Whether a TOML file is a valid config of a report and not also one of a pipeline."""
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
    """The absolute path; an empty text and ``builtin`` are returned unchanged."""
    return path if path in ("", "builtin") else str(Path(path).absolute())


def split_names(text: str) -> list[str]:
    """Names of a comma-separated list."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _command(program: str, options: dict[str, str]) -> str:
    return " ".join([program, *(f"--{name} {value}" for name, value in options.items() if value)])
