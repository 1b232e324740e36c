"""The plan of a PaperReport: a step for each method on each sweep of each mesh, so that only changes run again."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from z2p_core import registry
from z2p_core.config import ConfigError, to_dict
from z2p_core.config.report import SWEEP_NAMES, ReportConfig, Sweep, check_report, parse_report
from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import NO_TEXTURE, SYNTHETIC_SWEEPS, VIEW_CONTROLS
from z2p_renderer.pipeline.evaluation.paper.methods import BASELINE, TRUTH, WEIGHTS, Method, method_fields
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.storage.configs import read_config_text
from z2p_renderer.storage.models.checkpoints import WeightsError, find_weights, shipped_weights
from z2p_renderer.storage.results.fingerprints import STAGE_VERSIONS, file_digest, plugin_fields, stage_fields
from z2p_renderer.storage.results.stage_dependencies import PLACEMENT_CODE, WEIGHTS_ONLY_CODE
from z2p_renderer.storage.results.store import Entry
from z2p_renderer.storage.scans.clouds import find_scans, reader_of
from z2p_renderer.workflows.plan import MeshInput, Step, builtin_mesh, drop_duplicate_meshes, list_meshes, shapes_fields
from z2p_renderer.workflows.sources import split_names

MEASURE_PARAMETERS = ("views", "points", "resolution", "samples", "denoise", "seed")
"""Keys of the config that all measurements depend on."""
TRUTH_METHOD = Method("truth", TRUTH, "")


@dataclass(frozen=True)
class ReportStep(Step):
    """A step of the report, with the name of its sweep and its method."""

    sweep: str = ""
    method: Method | None = None


@dataclass(frozen=True)
class ReportPlan:
    """A report's steps, and the meshes, methods and scans that they measure."""

    config: ReportConfig
    steps: dict[str, ReportStep]
    """All steps by name, upstream first."""
    meshes: tuple[MeshInput, ...]
    methods: tuple[Method, ...]
    scans: tuple[Path, ...]
    command: str
    """The command line that makes this report; shown on its page."""
    warnings: tuple[str, ...] = ()


@lru_cache(maxsize=4)
def load_report_plan(source: str) -> ReportPlan:
    """Plan of a `report_source`; each process computes it once.

    Raises:
        ConfigError: the config cannot be used, or a method or a sweep is unknown.
        ScanError: a folder of meshes or scans is missing or empty.
        PluginError: a plugin that it names is unknown or broken.
    """
    inputs = json.loads(source)["report"]
    config = ReportConfig()
    if inputs["config"]:
        path = Path(inputs["config"])
        config = parse_report(read_config_text(path), str(path))
    overrides: dict[str, Any] = {key: inputs[key] for key in ("meshes", "scans") if inputs[key]}
    if inputs["weights"]:
        overrides["weights"] = tuple(split_names(inputs["weights"]))
    config = check_report(replace(config, **overrides))
    return make_report_plan(_select_sweeps(config, split_names(inputs["sweeps"])), inputs["command"])


def make_report_plan(config: ReportConfig, command: str = "") -> ReportPlan:
    """Plan of a config. The files of its meshes, scans and weights are read to compute their sha256.

    Raises: as `load_report_plan`.
    """
    _check_name(config)
    builtin = config.meshes == "builtin"
    meshes, warnings = drop_duplicate_meshes(_builtin_meshes() if builtin else list_meshes(Path(config.meshes)))
    methods = report_methods(config)
    scans = tuple(find_scans([config.scans], recursive=False)) if config.scans else ()
    steps = [ReportStep(Entry("shapes", "shapes", shapes_fields()))] if builtin else []
    for name, sweep in config.sweeps().items():
        swept: Sequence[MeshInput | None] = [None] if name in SYNTHETIC_SWEEPS else meshes[: sweep.meshes or None]
        for mesh in swept:
            steps += _measure_steps(config, name, sweep, mesh, methods)
    if config.trust_draws:
        networks = [method for method in methods if method.kind == WEIGHTS]
        trust_meshes = meshes[: config.trust_meshes or None]
        steps += [_trust_step(config, mesh, method) for mesh in trust_meshes for method in networks]
    steps += [_scans_step(config, scans, method) for method in methods if scans]
    steps.append(_times_step(config, meshes[0], methods))
    steps.append(_page_step(config, command, steps, meshes, methods))
    return ReportPlan(
        config, {step.name: step for step in steps}, tuple(meshes), methods, scans, command, tuple(warnings)
    )


def report_methods(config: ReportConfig) -> tuple[Method, ...]:
    """The methods that a report compares: first the weights, then the baselines.

    Raises:
        ConfigError: weights that are unknown or need other versions of plugins, or two methods of the same name.
        PluginError: a baseline is unknown or broken.
    """
    methods = []
    for name in config.weights or tuple(shipped_weights()):
        try:
            load_plugins(find_weights(name))
        except WeightsError as error:
            raise ConfigError(f"weights: {error}") from error
        methods.append(Method(_method_name(name), WEIGHTS, name))
    methods += [Method(name, BASELINE, name) for name in config.baselines]
    names = [method.name for method in methods]
    for name in names:
        if names.count(name) > 1 or name == TRUTH:
            raise ConfigError(f"expected methods of different names, none of them {TRUTH!r}, got {', '.join(names)}; "
                              "rename a file of weights, or the folder of a training")
    return tuple(methods)


def _method_name(weights: str) -> str:
    """Name of weights in the report; for a training's ``weights.safetensors`` the name of its folder."""
    path = Path(weights)
    return (path.absolute().parent.name if path.stem == "weights" else "") or path.stem


def _measure_steps(
    config: ReportConfig, name: str, sweep: Sweep, mesh: MeshInput | None, methods: Sequence[Method]
) -> list[ReportStep]:
    """The steps of one sweep on one mesh (None: on synthetic shapes): ground truth, then each method."""
    subject = mesh.name if mesh else "shapes"
    shapes = _shapes_upstream(mesh)
    samplers = [level for level in sweep.levels if name == "sampling" and level != "non-uniform"] or ["uniform"]
    shared = stage_fields("measure") | _measure_fields(config) | {
        "sweep": name, "levels": list(sweep.levels), "mesh": mesh.identity if mesh else "",
        "samplers": [plugin_fields(registry.load("samplers", str(sampler))) for sampler in samplers],
    }  # fmt: skip
    if textures := [level for level in sweep.levels if name == "texture" and level != NO_TEXTURE]:
        shared["textures"] = [plugin_fields(registry.load("textures", str(texture))) for texture in textures]
    truth = f"measure/{name}/{subject}/truth"
    steps = []
    for method in (TRUTH_METHOD, *methods):
        fields = _without_network_code(method, shared) | {"method": method_fields(method)}
        entry = Entry("measure", f"measure/{name}/{subject}/{method.name}", fields)
        upstream = shapes if method == TRUTH_METHOD else (*shapes, truth)
        steps.append(ReportStep(entry, upstream, mesh, sweep=name, method=method))
    return steps


def _without_network_code(method: Method, fields: dict[str, Any]) -> dict[str, Any]:
    """The fields; for a method without weights without the parts of the code that only networks need."""
    if method.kind == WEIGHTS:
        return fields
    unused = set(WEIGHTS_ONLY_CODE) - set(PLACEMENT_CODE if fields["stage"] == "scans" else ())
    return fields | {"code": {part: digest for part, digest in fields["code"].items() if part not in unused}}


def _shapes_upstream(mesh: MeshInput | None) -> tuple[str, ...]:
    """Upstream steps of a step that reads the mesh: a built-in shape comes from ``shapes``."""
    return ("shapes",) if mesh and mesh.path is None else ()


def _trust_step(config: ReportConfig, mesh: MeshInput, method: Method) -> ReportStep:
    fields = stage_fields("trust") | _measure_fields(config) | {
        "mesh": mesh.identity, "method": method_fields(method), "draws": config.trust_draws,
        "samplers": [plugin_fields(registry.load("samplers", "uniform"))],
    }  # fmt: skip
    entry = Entry("trust", f"trust/{mesh.name}/{method.name}", fields)
    return ReportStep(entry, _shapes_upstream(mesh), mesh, method=method)


def _times_step(config: ReportConfig, mesh: MeshInput, methods: Sequence[Method]) -> ReportStep:
    fields = stage_fields("times") | {
        "mesh": mesh.identity, "methods": [method_fields(method) for method in methods], "points": config.points,
        "repeats": config.time_repeats, "samples": config.samples, "denoise": config.denoise, "seed": config.seed,
    }  # fmt: skip
    entry = Entry("times", "times", fields)
    return ReportStep(entry, _shapes_upstream(mesh), mesh, files=_weights_files(methods))


def _page_step(
    config: ReportConfig,
    command: str,
    upstream: Sequence[ReportStep],
    meshes: Sequence[MeshInput],
    methods: Sequence[Method],
) -> ReportStep:
    template = Path(__file__).parents[2] / "pipeline" / "templates" / "report.html"
    fields = stage_fields("report") | {
        "upstream": [step.entry.fingerprint for step in upstream], "config": to_dict(config), "command": command,
        "template": file_digest(template), "meshes": [mesh.name for mesh in meshes],
    }  # fmt: skip
    files = ((template, fields["template"]), *_weights_files(methods))
    return ReportStep(Entry("report", "report", fields), tuple(step.name for step in upstream), files=files)


def _weights_files(methods: Sequence[Method]) -> tuple[tuple[Path, str], ...]:
    """Path and sha256 of all weights, for steps that use more than one method."""
    networks = [method for method in methods if method.kind == WEIGHTS]
    return tuple((find_weights(method.source).absolute(), method_fields(method)["sha256"]) for method in networks)


def _scans_step(config: ReportConfig, scans: Sequence[Path], method: Method) -> ReportStep:
    files = tuple((path.absolute(), file_digest(path)) for path in scans)
    fields = _without_network_code(method, stage_fields("scans")) | _measure_fields(config) | {
        "scans": [[path.name, digest, plugin_fields(reader_of(path))] for path, digest in files],
        "method": method_fields(method),
    }  # fmt: skip
    return ReportStep(Entry("scans", f"scans/{method.name}", fields), method=method, files=files)


def _measure_fields(config: ReportConfig) -> dict[str, Any]:
    return {
        "parameters": {name: getattr(config, name) for name in MEASURE_PARAMETERS},
        "controls": [plugin_fields(registry.load("controls", name)) for name in VIEW_CONTROLS],
    }


def _builtin_meshes() -> list[MeshInput]:
    from z2p_renderer.pipeline.shapes import VALIDATION_SHAPES

    return [builtin_mesh(name) for name in VALIDATION_SHAPES]


def _select_sweeps(config: ReportConfig, sweeps: Sequence[str]) -> ReportConfig:
    """The config with the levels of other sweeps left out; the plain case stays."""
    unknown = [name for name in sweeps if name not in SWEEP_NAMES]
    if unknown:
        raise ConfigError(f"--sweeps: unknown {unknown[0]!r}; known: {', '.join(SWEEP_NAMES)}")
    if not sweeps:
        return config
    others = {name: type(sweep)() for name, sweep in config.sweeps().items() if name not in ("base", *sweeps)}
    return replace(config, **others)  # type: ignore[arg-type]


def _check_name(config: ReportConfig) -> None:
    name = config.name
    if not name or name.startswith(".") or Path(name).name != name or name in {*STAGE_VERSIONS, "truth"}:
        raise ConfigError(f"name: expected a plain folder name that is no stage's, got {name!r}")
