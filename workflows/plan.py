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
    RENDER_STAGE,
    STAGE_VERSIONS,
    TEXTURED_RENDER_STAGE,
    file_digest,
    fingerprint,
    plugin_fields,
    stage_fields,
)
from z2p_renderer.storage.results.store import Entry
from z2p_renderer.workflows.pretrained_weights import PRETRAINED_KEYS, pretrained_fields, pretrained_files

USER_ERRORS = (ConfigError, ScanError, registry.PluginError)
"""Errors that the user can fix; their messages say how, so they are printed without a traceback."""


@dataclass(frozen=True)
class MeshInput:
    """One mesh, with an identity that depends only on its content."""

    name: str
    identity: str
    """64 hex digits: sha256 of the file, or for a built-in shape of what makes it."""
    path: Path | None
    """None for a built-in shape, whose file is in the `shapes` result."""


@dataclass(frozen=True)
class Step:
    """One task of a plan: the result that it makes, and the upstream steps whose results it reads."""

    entry: Entry
    upstream: tuple[str, ...] = ()
    """Names of other steps of the plan."""
    mesh: MeshInput | None = None
    views: tuple[int, int] = (0, 0)
    """Index of a render step's first view, and of the one after its last."""
    files: tuple[tuple[Path, str], ...] = ()
    """Other files that the step reads, each with its sha256 as in the fields. The task fails if a file has changed."""

    @property
    def name(self) -> str:
        """Logical name such as ``sample/bunny``."""
        return self.entry.name


class NamedConfig(Protocol):
    """The configuration of any plan."""

    @property
    def name(self) -> str:
        """Name of the folder with the links to its results."""


class AnyPlan(Protocol):
    """The part that pipeline, ablation and report plans share: enough for status, progress and garbage collection."""

    @property
    def config(self) -> NamedConfig:
        """The configuration that the plan was made from."""

    @property
    def steps(self) -> Mapping[str, Step]:
        """All steps by name, upstream first."""


@dataclass(frozen=True)
class Plan:
    """A FullPipeline's steps and meshes."""

    config: PipelineConfig
    steps: dict[str, Step]
    """All steps by name, upstream first."""
    training: tuple[MeshInput, ...]
    evaluation: tuple[MeshInput, ...]
    warnings: tuple[str, ...] = ()


def make_plan(config: PipelineConfig) -> Plan:
    """Plan of a config. The files in its mesh folders are read to compute their sha256.

    Raises:
        ConfigError: values that do not fit together.
        ScanError: a mesh folder is missing or empty.
        PluginError: a plugin that the config names is unknown or broken.
    """
    check_config(config)
    training, warnings = drop_duplicate_meshes(_configured_meshes(config.meshes, held_out=False))
    if len(training) * config.render.views < 2:
        raise ConfigError("render.views: expected two renders or more in all, to train on and to validate with, got "
                          f"{config.render.views} of {len(training)} mesh")
    evaluation = training
    if config.evaluate_meshes or config.meshes == "builtin":
        held_out = _configured_meshes(config.evaluate_meshes or "builtin", held_out=True)
        evaluation, duplicate_warnings = drop_duplicate_meshes(held_out)
        warnings += duplicate_warnings
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
    """Plan of a config and of meshes whose identities are known. No mesh file is read."""
    steps: list[Step] = []
    if any(mesh.path is None for mesh in [*training, *evaluation]):
        steps.append(Step(Entry("shapes", "shapes", shapes_fields())))
    shards = []
    for mesh in training:
        mesh_steps = _mesh_steps(config, mesh)
        shards.append(mesh_steps[-1])
        steps += mesh_steps
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
    provenance = {"mesh": str(mesh.path or "builtin")}
    pool = Step(Entry("sample", f"sample/{mesh.name}", _sample_fields(config, mesh), provenance), shapes, mesh)
    render, stage = _render_fields(config, mesh), render_stage(config)
    chunks = []
    for first in range(0, config.render.views, config.render.chunk):
        last = min(first + config.render.chunk, config.render.views)
        fields = {**render, "first": first, "last": last}
        entry = Entry(stage, f"render/{mesh.name}/{first}-{last}", fields, provenance)
        chunks.append(Step(entry, shapes, mesh, (first, last)))
    shard = stage_fields("shard") | {
        # all renders together: how the views were divided into chunks does not matter
        "renders": fingerprint(render),
        "views": config.render.views,
        "sample": pool.entry.fingerprint,
        "parameters": to_dict(config.shard),
        "controls": _control_fields(config),
    }
    upstream = (pool.name, *(chunk.name for chunk in chunks))
    return [pool, *chunks, Step(Entry("shard", f"shard/{mesh.name}", shard, provenance), upstream, mesh)]


def shapes_fields() -> dict[str, Any]:
    """Fields of the result that holds all built-in shapes."""
    from z2p_renderer.pipeline.shapes import TRAINING_SHAPES, VALIDATION_SHAPES

    return stage_fields("shapes") | {"shapes": sorted([*TRAINING_SHAPES, *VALIDATION_SHAPES])}


def _sample_fields(config: PipelineConfig, mesh: MeshInput) -> dict[str, Any]:
    parameters = to_dict(config.sample)
    parameters["sampler"] = plugin_fields(registry.load("samplers", config.sample.sampler))
    return stage_fields("sample") | {"mesh": mesh.identity, "parameters": parameters}


def _render_fields(config: PipelineConfig, mesh: MeshInput) -> dict[str, Any]:
    """Fields that all views of a mesh share. The number of views is not among them, so raising it keeps old renders."""
    parameters = to_dict(config.render)
    for name in ("views", "chunk"):
        del parameters[name]
    parameters["controls"] = _control_fields(config)
    textures, share = parameters.pop("textures"), parameters.pop("textured_share")
    if textures:  # without, renders stay valid that were made before these keys existed
        parameters["textures"] = [plugin_fields(registry.load("textures", name)) for name in textures]
        parameters["textured_share"] = share
    return stage_fields(render_stage(config)) | {"mesh": mesh.identity, "parameters": parameters}


def render_stage(config: PipelineConfig) -> str:
    """The stage of a config's renders: those with textures are made by other code."""
    return TEXTURED_RENDER_STAGE if config.render.textures else RENDER_STAGE


def _train_fields(config: PipelineConfig, shards: Iterable[Step]) -> dict[str, Any]:
    parameters = to_dict(config.train)
    del parameters["checkpoint_every"]  # resuming is exact, so the number of checkpoints does not change the weights
    for name in PRETRAINED_KEYS:
        del parameters[name]
    parameters |= pretrained_fields(config.train, config.render.controls)
    network = parameters["network"]
    if network["conditioning"] == NetworkConfig.conditioning:
        del network["conditioning"]  # keeps results adoptable that were made before this key existed
    if conditions := network.pop("conditions"):  # as above
        network["conditions"] = [plugin_fields(registry.load("conditions", name)) for name in conditions]
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
    if textures := parameters.pop("textures"):  # without, results are adoptable that were made before this key existed
        parameters["textures"] = [plugin_fields(registry.load("textures", name)) for name in textures]
    return stage_fields("evaluate") | {
        "train": train.entry.fingerprint,
        "meshes": sorted([mesh.name, mesh.identity] for mesh in meshes),  # names, because metrics.json has them
        "parameters": parameters,
    }


def _control_fields(config: PipelineConfig) -> list[dict[str, str]]:
    """Fields of the controls in the config's order, which is that of the settings vector and of the random draws."""
    return [plugin_fields(registry.load("controls", name)) for name in config.render.controls]


def _shapes_upstream(meshes: Iterable[MeshInput]) -> tuple[str, ...]:
    return ("shapes",) if any(mesh.path is None for mesh in meshes) else ()


def _configured_meshes(folder: str, *, held_out: bool) -> list[MeshInput]:
    """The meshes of a folder, or for ``builtin`` the shapes to train on or those held out for evaluation."""
    if folder == "builtin":
        from z2p_renderer.pipeline.shapes import TRAINING_SHAPES, VALIDATION_SHAPES

        return [builtin_mesh(name) for name in (VALIDATION_SHAPES if held_out else TRAINING_SHAPES)]
    return list_meshes(Path(folder))


def builtin_mesh(name: str) -> MeshInput:
    """A built-in shape. Making it is deterministic, so its identity is a digest of the code that makes it."""
    return MeshInput(name, fingerprint(stage_fields("shapes") | {"shape": name}), None)


def list_meshes(folder: Path) -> list[MeshInput]:
    """The meshes in a folder (not in its subfolders), ordered by name.

    Raises:
        ScanError: no such folder, or no mesh in it.
    """
    return [MeshInput(name, file_digest(path), path.absolute()) for name, path in find_meshes(folder).items()]


def drop_duplicate_meshes(meshes: Iterable[MeshInput]) -> tuple[list[MeshInput], list[str]]:
    """The meshes of different content, and a warning for each duplicate that was left out."""
    unique: dict[str, MeshInput] = {}
    warnings = []
    for mesh in meshes:
        if mesh.identity in unique:
            warnings.append(f"mesh {mesh.name} is left out: its file is the same as {unique[mesh.identity].name}'s")
        unique.setdefault(mesh.identity, mesh)
    return list(unique.values()), warnings


def check_config(config: PipelineConfig) -> None:
    """Check that each value of the config is within its limits, and that the values are consistent.

    Raises:
        ConfigError: a value is out of its limits, or contradicts others.
        PluginError: a plugin is not installed.
    """
    name = config.name
    if name in {*STAGE_VERSIONS, "truth"}:
        raise ConfigError(f"name: {name!r} is the folder of a stage's results; choose another name")
    check_values(config)
