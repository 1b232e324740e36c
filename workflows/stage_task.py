"""What every stage's luigi task has in common: its place in the plan, its result in the store, its log.

A task's id holds the fingerprint of its result, so a task whose inputs changed is another task to the scheduler.
"""

from __future__ import annotations

import shutil
import time
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, ClassVar

import luigi

from z2p_core.config import ConfigError
from z2p_core.native.source_digest import are_kernels_outdated
from z2p_renderer.storage.files.disk_errors import disk_error_message
from z2p_renderer.storage.results.fingerprints import changed_plugins, file_digest
from z2p_renderer.storage.results.stage_dependencies import changed_parts
from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.mesh_warnings import mesh_warnings
from z2p_renderer.workflows.plan import USER_ERRORS, MeshInput, Plan, Step
from z2p_renderer.workflows.plan_loading import load_pipeline_plan, load_plan
from z2p_renderer.workflows.process.exit_status import record_failure
from z2p_renderer.workflows.process.signals import exit_on_interrupt
from z2p_renderer.workflows.process.task_log import last_lines, log_line, output_to_log
from z2p_renderer.workflows.sources import absolute_path

LOG_NAME = "task.log"
C_FOLDER = "z2p_core/native/c/"
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
        return load_pipeline_plan(self.source)

    @property
    def steps(self) -> Mapping[str, Step]:
        """All steps that the task's own is one of."""
        return load_plan(self.source).steps

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
        """The task's log file; a finished one is also in its result's folder, as `LOG_NAME`."""
        return self.store.log(self.step.entry)

    def requires(self) -> list[StageTask]:
        return [create_task(self.steps[name], self.source, self.workspace) for name in self.step.upstream]

    def complete(self) -> bool:
        with reporting_broken(self):
            return self.store.complete(self.step.entry)

    def run(self) -> None:
        if self.complete():
            log_line(f"{self.step_name}: found, made elsewhere meanwhile")
            return
        started = time.perf_counter()
        made: list[Path] = []

        def make(out: Path) -> None:
            made.append(out)
            self.make(out)

        with exit_on_interrupt(self.step_name), output_to_log(self.log):
            log_line(f"{self.step_name}: started")
            self._check_code()
            for task in self.requires():
                task.repair_if_damaged()
            if self.stage == "sample":  # the first that reads a mesh
                for warning in mesh_warnings(self.mesh_path()):
                    log_line(f"warning: {warning}")
            self.store.produce(self.step.entry, make, resumable=self.resumable, leftovers=("**/.*", *self.leftovers))
            if made:
                self._show_log()
            how = f"done in {time.perf_counter() - started:.1f} s" if made else "found, made elsewhere meanwhile"
            log_line(f"{self.step_name}: {how}")

    def repair_if_damaged(self) -> None:
        """Check every byte of the result before it is read; a damaged one is put aside and made again, here and now."""
        faults = self.store.verify(self.step.entry)
        if faults:
            log_line(f"{self.step_name}: damaged, made again: {faults[0]}")
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
        if any(part.startswith(C_FOLDER) for part in fields["code"]) and are_kernels_outdated():
            raise ConfigError(f"{self.step_name}: the compiled kernels are not those of the C files in {C_FOLDER}; "
                              "install z2p again")
        self._check_files()

    def _check_files(self) -> None:
        """Weights, scans and the like are read hours after the plan: they must be what the fingerprint says."""
        for path, digest in self.step.files:
            _check_file(path, digest)

    def _show_log(self) -> None:
        """Put the log beside the files that it tells of; it is no part of the result, and failing to harms none."""
        shown = self.store.folder(self.step.entry) / LOG_NAME
        with suppress(OSError):
            shown.unlink(missing_ok=True)
            try:
                shown.hardlink_to(self.log)
            except OSError:  # a filesystem without hard links
                shutil.copyfile(self.log, shown)

    def on_failure(self, exception: BaseException) -> Any:
        refused = disk_error_message(exception, self.store.root)
        reason = refused or f"{type(exception).__name__}: {exception}"
        report_failure(self, reason, bool(refused) or isinstance(exception, USER_ERRORS), temporary=bool(refused))
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


def create_task(step: Step, source: str, workspace: str) -> StageTask:
    """The task that makes a step's result."""
    kinds: dict[str, type[StageTask]] = {kind.stage: kind for kind in _iter_subclasses(StageTask)}
    return kinds[step.entry.stage](
        step_name=step.name, fingerprint=step.entry.fingerprint, workspace=workspace, source=source
    )


def _iter_subclasses(kind: type[StageTask]) -> Iterator[type[StageTask]]:
    for below in kind.__subclasses__():
        yield below
        yield from _iter_subclasses(below)


def report_failure(task: StageTask, reason: str, brief: bool = False, *, temporary: bool = False) -> None:
    """Say that a task failed and why, last of all; before that the end of its log, but for reasons that say it all."""
    lines = [] if brief else last_lines(task.log)
    if lines:
        log_line("\n".join(f"    {line}" for line in lines))
    first = next((line for line in reason.splitlines() if line.strip()), reason).rstrip(" :")
    where = "" if temporary else f"; log: {task.log}"
    record_failure(f"FAILED {task.step_name}: {first}{where}", temporary=temporary)


@contextmanager
def reporting_broken(task: luigi.Task) -> Iterator[None]:
    """Says why a task cannot be asked whether it is complete; luigi then leaves it out."""
    try:
        yield
    except Exception as error:
        report_broken_task(task, error)
        raise


@luigi.Task.event_handler(luigi.Event.BROKEN_TASK)
def report_broken_task(task: luigi.Task, exception: BaseException) -> None:
    """Say why a task cannot be planned: one line for what a user can mend or what may pass, all for the rest."""
    root = getattr(task, "workspace", None)
    refused = disk_error_message(exception, Path(absolute_path(root)) if root else None)
    if refused is None and not isinstance(exception, (*USER_ERRORS, OSError)):
        log_line("".join(traceback.format_exception(exception)))
    name = getattr(task, "step_name", task.task_family)
    record_failure(f"FAILED {name}: {refused or exception}", temporary=bool(refused))


@luigi.Task.event_handler(luigi.Event.PROCESS_FAILURE)
def _report_task_death(task: luigi.Task, reason: str) -> None:
    """A task's process died without a word, by a crash or a kill; told by the process that started it."""
    if isinstance(task, StageTask):
        report_failure(task, f"its process died: {reason.partition('died ')[2] or reason}")
