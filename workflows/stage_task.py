"""What every stage's luigi task has in common: its place in the plan, its result in the store, its log.

A task's id holds the fingerprint of its result, so a task whose inputs changed is another task to the scheduler.
"""

from __future__ import annotations

import json
import shutil
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import luigi

from z2p_core.config import ConfigError, PipelineConfig, from_dict, parse_config, to_dict
from z2p_core.native.source_digest import outdated
from z2p_core.registry import PluginError
from z2p_renderer.storage.configs import config_text
from z2p_renderer.storage.files.disk_errors import disk_error_message
from z2p_renderer.storage.results.fingerprints import changed_plugins, file_digest
from z2p_renderer.storage.results.stage_dependencies import changed_parts
from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.mesh_warnings import mesh_warnings
from z2p_renderer.workflows.plan import USERS_ERRORS, MeshInput, Plan, Step, check_config, make_plan
from z2p_renderer.workflows.process.exit_status import fail
from z2p_renderer.workflows.process.signals import ended_by_interrupt
from z2p_renderer.workflows.process.task_log import last_lines, logged, say

LOG = "task.log"
KERNELS = "z2p_core/native/c/"
"""How parts of a fingerprint begin that run only once they are compiled."""


class StageTask(luigi.Task):
    """One step of the plan; subclasses say how its files are made."""

    step_name = luigi.Parameter(description="logical name, such as render/bunny/0-10")
    fingerprint = luigi.Parameter(description="fingerprint of the result")
    workspace = luigi.Parameter()
    source = luigi.Parameter(significant=False)

    stage: ClassVar[str] = ""
    resumable: ClassVar[bool] = False
    leftovers: ClassVar[tuple[str, ...]] = ()

    @property
    def plan(self) -> Plan:
        return load_plan(self.source)

    @property
    def steps(self) -> dict[str, Step]:
        """All steps that the task's own is one of."""
        return load_steps(self.source)

    @property
    def step(self) -> Step:
        step = self.steps.get(self.step_name)
        if step is None or step.entry.fingerprint != self.fingerprint:
            raise ConfigError(f"{self.step_name}: config, meshes, plugins or code changed since the pipeline started; "
                              "start it again")
        return step

    @property
    def store(self) -> Store:
        return Store(Path(self.workspace))

    @property
    def log(self) -> Path:
        """The task's log file; a finished one is also in its result's folder, as `LOG`."""
        return self.store.log(self.step.entry)

    def requires(self) -> list[StageTask]:
        return [task_of(self.steps[name], self.source, self.workspace) for name in self.step.upstream]

    def complete(self) -> bool:
        with broken_told(self):
            return self.store.complete(self.step.entry)

    def run(self) -> None:
        if self.complete():
            say(f"{self.step_name}: found, made elsewhere meanwhile")
            return
        started = time.perf_counter()
        made: list[Path] = []

        def make(out: Path) -> None:
            made.append(out)
            self.make(out)

        with ended_by_interrupt(self.step_name), logged(self.log):
            say(f"{self.step_name}: started")
            self._check_code()
            for task in self.requires():
                task.mend()
            if self.stage == "sample":  # the first that reads a mesh
                for warning in mesh_warnings(self.mesh_path()):
                    say(f"warning: {warning}")
            self.store.produce(self.step.entry, make, resumable=self.resumable, leftovers=("**/.*", *self.leftovers))
            if made:
                self._show_log()
            how = f"done in {time.perf_counter() - started:.1f} s" if made else "found, made elsewhere meanwhile"
            say(f"{self.step_name}: {how}")

    def mend(self) -> None:
        """Check every byte of the result before it is read; a damaged one is put aside and made again, here and now."""
        faults = self.store.verify(self.step.entry)
        if faults:
            say(f"{self.step_name}: damaged, made again: {faults[0]}")
            self.store.quarantine_if_damaged(self.step.entry)
            self.run()

    def _check_code(self) -> None:
        """Code is imported as late as here, and later by Blender: it must be what the fingerprint says.

        A plugin that was loaded before an edit would have its results kept under the edited one's name.
        """
        fields = self.step.entry.fields
        changed = changed_parts(fields["code"]) + [f"plugin {name}" for name in changed_plugins(fields)]
        if changed:
            raise ConfigError(f"{self.step_name}: {changed[0]} changed since the pipeline started; start it again")
        if any(part.startswith(KERNELS) for part in fields["code"]) and outdated():
            raise ConfigError(f"{self.step_name}: the compiled kernels are not those of the C files in {KERNELS}; "
                              "install z2p again")
        self._check_files()

    def _check_files(self) -> None:
        """Weights, scans and the like are read hours after the plan: they must be what the fingerprint says."""
        for path, digest in self.step.files:
            _check_file(path, digest)

    def _show_log(self) -> None:
        """Put the log beside the files that it tells of; it is no part of the result, and failing to harms none."""
        shown = self.store.folder(self.step.entry) / LOG
        with suppress(OSError):
            shown.unlink(missing_ok=True)
            try:
                shown.hardlink_to(self.log)
            except OSError:  # a filesystem without hard links
                shutil.copyfile(self.log, shown)

    def on_failure(self, exception: BaseException) -> Any:
        refused = disk_error_message(exception, self.store.root)
        reason = refused or f"{type(exception).__name__}: {exception}"
        tell_failure(self, reason, bool(refused) or isinstance(exception, USERS_ERRORS), passing=bool(refused))
        return super().on_failure(exception)

    def make(self, out: Path) -> None:
        """Write the step's files into `out`."""
        raise NotImplementedError

    def upstream_folders(self, stage: str) -> list[Path]:
        """Result folders of the upstream steps of a stage, in the plan's order."""
        entries = [self.steps[name].entry for name in self.step.upstream]
        return [self.store.folder(entry) for entry in entries if entry.stage == stage]

    def mesh_path(self, mesh: MeshInput | None = None) -> Path:
        """File of a mesh, by default the step's own; of a user's, whose content is checked against the plan."""
        mesh = mesh or self.step.mesh
        if mesh is None:
            raise ValueError(f"{self.step_name} has no mesh")
        if mesh.path is None:
            from z2p_renderer.pipeline.shapes import shape_path

            return Path(shape_path(self.upstream_folders("shapes")[0], mesh.name))
        _check_file(mesh.path, mesh.identity)
        return mesh.path


def _check_file(path: Path, digest: str) -> None:
    if not path.is_file() or file_digest(path) != digest:
        raise ConfigError(f"{path}: the file changed since the pipeline started; start it again")


def task_of(step: Step, source: str, workspace: str) -> StageTask:
    """The task that makes a step's result."""
    kinds: dict[str, type[StageTask]] = {kind.stage: kind for kind in _kinds(StageTask)}
    return kinds[step.entry.stage](
        step_name=step.name, fingerprint=step.entry.fingerprint, workspace=workspace, source=source
    )


def _kinds(kind: type[StageTask]) -> Iterator[type[StageTask]]:
    for below in kind.__subclasses__():
        yield below
        yield from _kinds(below)


def source_of(config: str, meshes: str, evaluate_meshes: str) -> str:
    """Where config and meshes come from, as JSON with absolute paths: all that another process needs."""
    where = {"config": config, "meshes": meshes, "evaluate_meshes": evaluate_meshes}
    return json.dumps({key: absolute(value) for key, value in where.items()})


def absolute(path: str) -> str:
    """The path from the root; what is no path stays as it is."""
    return path if path in ("", "builtin") else str(Path(path).absolute())


@lru_cache(maxsize=8)
def load_plan(source: str) -> Plan:
    """Plan of a `source_of`, or of a `workflows.ablation.plan.variant_source`.

    It is made once a process, so that edits during a run do not mix two plans.

    Raises:
        ConfigError: the config cannot be used.
        ScanError: a mesh folder is missing or empty.
        PluginError: the config names an unknown or broken plugin.
    """
    where = json.loads(source)
    if "variant" in where:
        from z2p_renderer.workflows.ablation.plan import (
            load_variant_plan,  # late: it builds on this module's neighbours
        )

        return load_variant_plan(source)
    config = PipelineConfig()
    if where["config"]:
        path = Path(where["config"])
        config = parse_config(config_text(path), str(path))
        with of_file(path):
            check_config(config)
    given = {key: where[key] for key in ("meshes", "evaluate_meshes") if where[key]}
    plan = make_plan(from_dict(PipelineConfig, to_dict(config) | given))
    for warning in plan.warnings:
        say(f"warning: {warning}")
    return plan


@contextmanager
def of_file(path: Path) -> Iterator[None]:
    """Tells what is wrong with a config's values with the name of its file."""
    try:
        yield
    except (ConfigError, PluginError) as error:
        raise type(error)(f"{path}: {error}") from error


def load_steps(source: str) -> dict[str, Step]:
    """Steps of a `source_of`, a `workflows.report.plan.report_source` or a source of `workflows.ablation.plan`."""
    where = json.loads(source)
    if "ablations" in where and "variant" not in where:
        from z2p_renderer.workflows.ablation.plan import load_ablation_plan

        return dict(load_ablation_plan(source).steps)
    if "report" in where:
        from z2p_renderer.workflows.report.plan import load_report_plan  # late: it builds on this module's neighbours

        return dict(load_report_plan(source).steps)
    return load_plan(source).steps


def tell_failure(task: StageTask, reason: str, brief: bool = False, *, passing: bool = False) -> None:
    """Say that a task failed and why, last of all; before that the end of its log, but for reasons that say it all."""
    lines = [] if brief else last_lines(task.log)
    if lines:
        say("\n".join(f"    {line}" for line in lines))
    first = next((line for line in reason.splitlines() if line.strip()), reason).rstrip(" :")
    where = "" if passing else f"; log: {task.log}"
    fail(f"FAILED {task.step_name}: {first}{where}", passing=passing)


@contextmanager
def broken_told(task: luigi.Task) -> Iterator[None]:
    """Says why a task cannot be asked whether it is complete; luigi then leaves it out."""
    try:
        yield
    except Exception as error:
        tell_broken(task, error)
        raise


@luigi.Task.event_handler(luigi.Event.BROKEN_TASK)
def tell_broken(task: luigi.Task, exception: BaseException) -> None:
    """Say why a task cannot be planned: one line for what a user can mend or what may pass, all for the rest."""
    root = getattr(task, "workspace", None)
    refused = disk_error_message(exception, Path(absolute(root)) if root else None)
    if refused is None and not isinstance(exception, (*USERS_ERRORS, OSError)):
        say("".join(traceback.format_exception(exception)))
    name = getattr(task, "step_name", task.task_family)
    fail(f"FAILED {name}: {refused or exception}", passing=bool(refused))


@luigi.Task.event_handler(luigi.Event.PROCESS_FAILURE)
def _tell_death(task: luigi.Task, reason: str) -> None:
    """A task's process died without a word, by a crash or a kill; told by the process that started it."""
    if isinstance(task, StageTask):
        tell_failure(task, f"its process died: {reason.partition('died ')[2] or reason}")
