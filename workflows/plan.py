"""The plan of a FullPipeline: every result it needs and what each depends on, computed from config and meshes alone.

Nothing is read but the meshes' bytes and the plugins' source, and nothing is written, so a plan can be made at any time
and compared with what a store holds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from z2p_core import registry
from z2p_core.config import ConfigError, NetworkConfig, PipelineConfig, to_dict
from z2p_core.config.pipeline_limits import check_values
from z2p_core.interfaces import ScanError
from z2p_renderer.pipeline.inference.engine_selection import REFERENCE_ENGINE
from z2p_renderer.storage.meshes import find_meshes
from z2p_renderer.storage.results.fingerprints import (
    STAGE_VERSIONS,
    file_digest,
    fingerprint,
    plugin_fields,
    stage_fields,
)
from z2p_renderer.storage.results.store import Entry
from z2p_renderer.workflows.pretrained_weights import PRETRAINED_KEYS, pretrained_fields, pretrained_files

USER_ERRORS = (ConfigError, ScanError, registry.PluginError)
"""Errors that a user can mend, with messages that say how."""


@dataclass(frozen=True)
class MeshInput:
    """One mesh: its name, and an identity that changes with its content and with nothing else."""

    name: str
    identity: str
    """64 hex digits: sha256 of the file, or for a built-in shape of what makes it."""
    path: Path | None
    """None for a built-in shape, which lies in the `shapes` result."""


@dataclass(frozen=True)
class Step:
    """One task: the result that it makes and the steps whose results it reads."""

    entry: Entry
    upstream: tuple[str, ...] = ()
    """Names of other steps of the plan."""
    mesh: MeshInput | None = None
    views: tuple[int, int] = (0, 0)
    """First view and the one after the last, of a render step."""
    files: tuple[tuple[Path, str], ...] = ()
    """Other files that it reads, each with the sha256 that is in the fields: it refuses others."""

    @property
    def name(self) -> str:
        """Logical name such as ``sample/bunny``."""
        return self.entry.name


class NamedConfig(Protocol):
    """A configuration of any plan."""

    @property
    def name(self) -> str:
        """What its results are kept under."""


class AnyPlan(Protocol):
    """What any plan is to those that keep its results and tell how it is doing."""

    @property
    def config(self) -> NamedConfig:
        """What it was made of."""

    @property
    def steps(self) -> Mapping[str, Step]:
        """All steps by name, upstream first."""


@dataclass(frozen=True)
class Plan:
    """All steps by name, upstream first, and what they work on."""

    config: PipelineConfig
    steps: dict[str, Step]
    training: tuple[MeshInput, ...]
    evaluation: tuple[MeshInput, ...]
    warnings: tuple[str, ...] = ()


def make_plan(config: PipelineConfig) -> Plan:
    """Plan of a config; its mesh folders are read for their contents' digests.

    Raises:
        ConfigError: values that do not fit together.
        ScanError: a mesh folder is missing or empty.
        PluginError: a plugin that the config names is unknown or broken.
    """
    check_config(config)
    training, warnings = drop_duplicate_meshes(_configured_meshes(config.meshes, kept_aside=False))
    if len(training) * config.render.views < 2:
        raise ConfigError("render.views: expected two renders or more in all, to train on and to validate with, got "
                          f"{config.render.views} of {len(training)} mesh")
    evaluation = training
    if config.evaluate_meshes or config.meshes == "builtin":
        evaluation, repeated = drop_duplicate_meshes(_configured_meshes(config.evaluate_meshes or "builtin", kept_aside=True))
        warnings += repeated
    else:
        warnings += ["no meshes kept aside for evaluation (--evaluate-meshes): the metrics are taken on the training "
                     "meshes and measure memory rather than quality"]
    return assemble_plan(config, training, evaluation, warnings)


def assemble_plan(
    config: PipelineConfig,
    training: Sequence[MeshInput],
    evaluation: Sequence[MeshInput],
    warnings: Sequence[str] = (),
) -> Plan:
    """Plan of a config and meshes whose identities are known; no mesh is read."""
    steps: list[Step] = []
    if any(mesh.path is None for mesh in [*training, *evaluation]):
        steps.append(Step(Entry("shapes", "shapes", shapes_fields())))
    shards = []
    for mesh in training:
        chain = _mesh_steps(config, mesh)
        shards.append(chain[-1])
        steps += chain
    fields = _train_fields(config, shards)
    upstream, files = tuple(shard.name for shard in shards), pretrained_files(config.train, fields["parameters"])
    train = Step(Entry("train", "train", fields), upstream, files=files)
    evaluate = Step(
        Entry("evaluate", "evaluate", _evaluate_fields(config, train, evaluation)),
        (train.name, *_shapes_upstream(evaluation)),
    )
    steps += [train, evaluate]
    return Plan(config, {step.name: step for step in steps}, tuple(training), tuple(evaluation), tuple(warnings))


def _mesh_steps(config: PipelineConfig, mesh: MeshInput) -> list[Step]:
    """A mesh's own steps: its pool of points, its chunks of renders, and last its shard."""
    shapes = _shapes_upstream([mesh])
    where = {"mesh": str(mesh.path or "builtin")}
    pool = Step(Entry("sample", f"sample/{mesh.name}", _sample_fields(config, mesh), where), shapes, mesh)
    render = _render_fields(config, mesh)
    chunks = []
    for first in range(0, config.render.views, config.render.chunk):
        last = min(first + config.render.chunk, config.render.views)
        fields = {**render, "first": first, "last": last}
        entry = Entry("render", f"render/{mesh.name}/{first}-{last}", fields, where)
        chunks.append(Step(entry, shapes, mesh, (first, last)))
    shard = stage_fields("shard") | {
        # the renders as a whole: how they were cut into chunks does not matter
        "renders": fingerprint(render),
        "views": config.render.views,
        "sample": pool.entry.fingerprint,
        "parameters": to_dict(config.shard),
        "controls": _control_fields(config),
    }
    upstream = (pool.name, *(chunk.name for chunk in chunks))
    return [pool, *chunks, Step(Entry("shard", f"shard/{mesh.name}", shard, where), upstream, mesh)]


def shapes_fields() -> dict[str, Any]:
    from z2p_renderer.pipeline.shapes import TRAINING_SHAPES, VALIDATION_SHAPES

    return stage_fields("shapes") | {"shapes": sorted([*TRAINING_SHAPES, *VALIDATION_SHAPES])}


def _sample_fields(config: PipelineConfig, mesh: MeshInput) -> dict[str, Any]:
    parameters = to_dict(config.sample)
    parameters["sampler"] = plugin_fields(registry.load("samplers", config.sample.sampler))
    return stage_fields("sample") | {"mesh": mesh.identity, "parameters": parameters}


def _render_fields(config: PipelineConfig, mesh: MeshInput) -> dict[str, Any]:
    """Fields that all views of a mesh share. Their number is not one: asking for more keeps those that are there."""
    parameters = to_dict(config.render)
    for name in ("views", "chunk"):
        del parameters[name]
    parameters["controls"] = _control_fields(config)
    return stage_fields("render") | {"mesh": mesh.identity, "parameters": parameters}


def _train_fields(config: PipelineConfig, shards: Iterable[Step]) -> dict[str, Any]:
    parameters = to_dict(config.train)
    del parameters["checkpoint_every"]  # a run resumes exactly, so how often it could does not matter
    for name in PRETRAINED_KEYS:
        del parameters[name]
    parameters |= pretrained_fields(config.train, config.render.controls)
    network = parameters["network"]
    if network["conditioning"] == NetworkConfig.conditioning:
        del network["conditioning"]  # results of before there was a choice mean the same, and can be adopted
    network["zbuffer"] = plugin_fields(registry.load("zbuffers", network["zbuffer"]))
    network["gbuffer"] = plugin_fields(registry.load("gbuffers", network["gbuffer"]))
    network["encoder"] = plugin_fields(registry.load("encoders", network["encoder"]))
    return stage_fields("train") | {
        "shards": sorted(shard.entry.fingerprint for shard in shards),
        "parameters": parameters,
        "controls": _control_fields(config),
    }


def _evaluate_fields(config: PipelineConfig, train: Step, meshes: Iterable[MeshInput]) -> dict[str, Any]:
    parameters = to_dict(config.evaluate)
    parameters["sampler"] = plugin_fields(registry.load("samplers", config.evaluate.sampler))
    parameters["engine"] = plugin_fields(registry.load("engines", REFERENCE_ENGINE))
    return stage_fields("evaluate") | {
        "train": train.entry.fingerprint,
        "meshes": sorted([mesh.name, mesh.identity] for mesh in meshes),  # the metrics' rows bear the names
        "parameters": parameters,
    }


def _control_fields(config: PipelineConfig) -> list[dict[str, str]]:
    """In the config's order: it is that of the settings vector, and of the draws from the generator."""
    return [plugin_fields(registry.load("controls", name)) for name in config.render.controls]


def _shapes_upstream(meshes: Iterable[MeshInput]) -> tuple[str, ...]:
    return ("shapes",) if any(mesh.path is None for mesh in meshes) else ()


def _configured_meshes(where: str, *, kept_aside: bool) -> list[MeshInput]:
    if where == "builtin":
        from z2p_renderer.pipeline.shapes import TRAINING_SHAPES, VALIDATION_SHAPES

        return [builtin_mesh(name) for name in (VALIDATION_SHAPES if kept_aside else TRAINING_SHAPES)]
    return list_meshes(Path(where))


def builtin_mesh(name: str) -> MeshInput:
    """A built-in shape; it is made the same every time, so what makes it stands for its content."""
    return MeshInput(name, fingerprint(stage_fields("shapes") | {"shape": name}), None)


def list_meshes(folder: Path) -> list[MeshInput]:
    """The meshes that lie in a folder (not below it), by name.

    Raises:
        ScanError: no such folder, or no mesh in it.
    """
    return [MeshInput(name, file_digest(path), path.absolute()) for name, path in find_meshes(folder).items()]


def drop_duplicate_meshes(meshes: Iterable[MeshInput]) -> tuple[list[MeshInput], list[str]]:
    """The meshes without repeated contents, and a warning for each that was left out."""
    found: dict[str, MeshInput] = {}
    warnings = []
    for mesh in meshes:
        if mesh.identity in found:
            warnings.append(f"mesh {mesh.name} is left out: its file is the same as {found[mesh.identity].name}'s")
        found.setdefault(mesh.identity, mesh)
    return list(found.values()), warnings


def check_config(config: PipelineConfig) -> None:
    """Nothing, when each of the config's values can be, and they fit together.

    Raises:
        ConfigError: one cannot, or they do not.
        PluginError: a plugin is not installed.
    """
    name = config.name
    if name in {*STAGE_VERSIONS, "truth"}:
        raise ConfigError(f"name: {name!r} is the folder of a stage's results; choose another name")
    check_values(config)
