"""The luigi tasks: one class a stage, whose run() hands its paths to one function of `pipeline`.

A task's id holds the fingerprint of its result, so a task whose inputs changed is another task to the scheduler.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import luigi

from storage.fingerprints import file_digest, fingerprint
from storage.layout import Store
from workflows.plan import MeshInput, Plan, Step, make_plan
from z2p_core.config import ConfigError, PipelineConfig, from_dict, parse_config, to_dict


class StageTask(luigi.Task):
    """One step of the plan; subclasses say how its files are made."""

    step_name = luigi.Parameter(description="logical name, such as render/bunny/0-10")
    fingerprint = luigi.Parameter(description="fingerprint of the result")
    workspace = luigi.Parameter()
    source = luigi.Parameter(significant=False)

    resumable: ClassVar[bool] = False
    leftovers: ClassVar[tuple[str, ...]] = ()

    @property
    def plan(self) -> Plan:
        return load_plan(self.source)

    @property
    def step(self) -> Step:
        step = self.plan.steps.get(self.step_name)
        if step is None or step.entry.fingerprint != self.fingerprint:
            raise ConfigError(f"{self.step_name}: config, meshes or plugins changed since the pipeline started; "
                              "start it again")
        return step

    @property
    def store(self) -> Store:
        return Store(Path(self.workspace))

    def requires(self) -> list[StageTask]:
        return [task_of(self.plan.steps[name], self.source, self.workspace) for name in self.step.upstream]

    def complete(self) -> bool:
        return self.store.complete(self.step.entry)

    def run(self) -> None:
        started = time.perf_counter()
        say(f"{self.step_name}: started")
        self.store.produce(
            self.step.entry, self.make, resumable=self.resumable, leftovers=(".*", *self.leftovers)
        )
        say(f"{self.step_name}: done in {time.perf_counter() - started:.1f} s")

    def on_failure(self, exception: BaseException) -> Any:
        say(f"FAILED {self.step_name}: {type(exception).__name__}: {exception}")
        return super().on_failure(exception)

    def make(self, out: Path) -> None:
        """Write the step's files into `out`."""
        raise NotImplementedError

    def upstream_folders(self, stage: str) -> list[Path]:
        """Result folders of the upstream steps of a stage, in the plan's order."""
        entries = [self.plan.steps[name].entry for name in self.step.upstream]
        return [self.store.folder(entry) for entry in entries if entry.stage == stage]

    def mesh_path(self, mesh: MeshInput | None = None) -> Path:
        """File of a mesh, by default the step's own; of a user's, whose content is checked against the plan."""
        mesh = mesh or self.step.mesh
        if mesh is None:
            raise ValueError(f"{self.step_name} has no mesh")
        if mesh.path is None:
            from pipeline.shapes import shape_path

            return Path(shape_path(self.upstream_folders("shapes")[0], mesh.name))
        if file_digest(mesh.path) != mesh.identity:
            raise ConfigError(f"{mesh.path}: the file changed since the pipeline started; start it again")
        return mesh.path


class Shapes(StageTask):
    """The built-in meshes."""

    def make(self, out: Path) -> None:
        from pipeline.shapes import make_shapes

        make_shapes(out)


class SampleMesh(StageTask):
    """A mesh's pool of points."""

    priority = 10  # before the renders: a broken mesh shows in the first minute and not after hours

    def make(self, out: Path) -> None:
        from pipeline.sample import sample_pool

        config = self.plan.config.sample
        sample_pool(self.mesh_path(), config, config.seed, out)


class RenderChunk(StageTask):
    """Some of a mesh's views; a killed one keeps what it has, and views rendered under another cut are copied."""

    resumable = True

    def make(self, out: Path) -> None:
        from pipeline.views import render_chunk

        step = self.step
        if step.mesh is None:
            raise ValueError(f"{self.step_name} has no mesh")
        self._copy_known_views(out)
        render_chunk(self.mesh_path(), step.mesh.identity, *step.views, self.plan.config.render, out, log=say)

    def _copy_known_views(self, out: Path) -> None:
        """Copy views that other chunks of the same renders hold, after a change of `views` or `chunk`."""
        wanted = _without_range(self.step.entry.fields)
        stems = {f"view_{index:05d}" for index in range(*self.step.views)}
        for folder, manifest in self.store.manifests("render"):
            if _without_range(manifest["fields"]) != wanted:
                continue
            files = {name: record for name, record in manifest["files"].items() if name.split(".")[0] in stems}
            # the picture last: the renderer takes its presence for the view's
            for name in sorted(files, key=lambda name: (name.count(".") == 1 and name.endswith(".png"), name)):
                if not (out / name).exists() and file_digest(folder / name) == files[name]["sha256"]:
                    shutil.copyfile(folder / name, out / f".{name}")
                    (out / f".{name}").replace(out / name)


class ShardMesh(StageTask):
    """A mesh's renders and points in one HDF5 file."""

    def make(self, out: Path) -> None:
        from pipeline.shard import make_shard
        from pipeline.views import load_controls

        config, mesh = self.plan.config, self.step.mesh
        pool = self.upstream_folders("sample")[0] / "pool.npy"
        controls = load_controls(config.render.controls)
        # told by its content, not by a name that may change while the shard stays
        identity = mesh.identity[:16] if mesh else ""
        make_shard(self.upstream_folders("render"), pool, config.shard, controls, out, identity)


class Train(StageTask):
    """Weights and learning curve."""

    resumable = True
    leftovers = ("checkpoints",)

    def make(self, out: Path) -> None:
        from pipeline.train import train

        # by fingerprint: renaming a mesh does not change the order in which training reads the shards
        shards = sorted(folder / "shard.h5" for folder in self.upstream_folders("shard"))
        train(shards, self.plan.config.train, out, log=say)


class Evaluate(StageTask):
    """Metrics and contact sheet against Blender's ground truth, on meshes kept aside."""

    def make(self, out: Path) -> None:
        from pipeline.evaluate import evaluate

        weights = self.upstream_folders("train")[0] / "weights.safetensors"
        meshes = {mesh.name: self.mesh_path(mesh) for mesh in self.plan.evaluation}
        evaluate(meshes, weights, out, self.plan.config.evaluate, self.store.root / "truth", log=say)


STAGES: dict[str, type[StageTask]] = {
    "shapes": Shapes,
    "sample": SampleMesh,
    "render": RenderChunk,
    "shard": ShardMesh,
    "train": Train,
    "evaluate": Evaluate,
}


@lru_cache(maxsize=8)
def load_plan(source: str) -> Plan:
    """Plan of a `FullPipeline.source`; made once a process, so that edits during a run do not mix two plans.

    Raises:
        ConfigError: the config cannot be used.
        ScanError: a mesh folder is missing or empty.
        PluginError: the config names an unknown or broken plugin.
    """
    where = json.loads(source)
    config = PipelineConfig()
    if where["config"]:
        path = Path(where["config"])
        if not path.is_file():
            raise ConfigError(f"--config: expected a TOML file, got {str(path)!r}, which is no file")
        config = parse_config(path.read_text(encoding="utf-8"), str(path))
    given = {key: where[key] for key in ("meshes", "evaluate_meshes") if where[key]}
    plan = make_plan(from_dict(PipelineConfig, to_dict(config) | given))
    for warning in plan.warnings:
        say(f"warning: {warning}")
    return plan


def say(line: str) -> None:
    """One line of progress on stderr."""
    print(line, file=sys.stderr, flush=True)


def task_of(step: Step, source: str, workspace: str) -> StageTask:
    return STAGES[step.entry.stage](
        step_name=step.name, fingerprint=step.entry.fingerprint, workspace=workspace, source=source
    )


def _without_range(fields: Any) -> str:
    return fingerprint({name: value for name, value in fields.items() if name not in ("first", "last")})
