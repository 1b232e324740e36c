"""The base of all stages' luigi tasks: it finds the task's step in the plan, its result in the store, and its log.

A task's id includes the fingerprint of its result, so after its inputs changed it is a new task to the scheduler.
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
MADE_ELSEWHERE = "found, made elsewhere meanwhile"
"""What the log says of a result that another pipeline made since this one was planned."""
C_FOLDER = "z2p_core/native/c/"
"""Start of the names of those parts of a fingerprint that have to be compiled before they take effect."""


class StageTask(luigi.Task):
    """One step of a plan. A subclass names its `stage`, and writes the result's files in `make`."""

    step_name = luigi.Parameter(description="logical name, such as render/bunny/0-10")
    fingerprint = luigi.Parameter(description="fingerprint of the result")
    workspace = luigi.Parameter()
    source = luigi.Parameter(significant=False)

    stage: ClassVar[str] = ""
    resumable: ClassVar[bool] = False
    """Whether `make` can continue from the files of an interrupted run."""
    leftovers: ClassVar[tuple[str, ...]] = ()
    """Glob patterns of files that only serve to resume; deleted once the result is published."""

    @property
    def plan(self) -> Plan:
        return load_pipeline_plan(self.source)

    @property
    def steps(self) -> Mapping[str, Step]:
        """All steps of the plan that the task belongs to, by name."""
        return load_plan(self.source).steps

    @property
    def step(self) -> Step:
        """The task's step.

        Raises:
            ConfigError: the plan has changed since the task was created.
        """
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
        """The task's log file. The log of a finished task is also in its result's folder, as `LOG_NAME`."""
        return self.store.log(self.step.entry)

    def requires(self) -> list[StageTask]:
        return [create_task(self.steps[name], self.source, self.workspace) for name in self.step.upstream]

    def complete(self) -> bool:
        with reporting_broken(self):
            return self.store.complete(self.step.entry)

    def run(self) -> None:
        if self.complete():
            log_line(f"{self.step_name}: {MADE_ELSEWHERE}")
            return
        started = time.perf_counter()
        was_made = False

        def make(out: Path) -> None:
            nonlocal was_made
            was_made = True
            self.make(out)

        with exit_on_interrupt(self.step_name), output_to_log(self.log):
            log_line(f"{self.step_name}: started")
            self._check_code()
            for task in self.requires():
                task.repair_if_damaged()
            if self.stage == "sample":  # the first stage that reads a mesh
                for warning in mesh_warnings(self.mesh_path()):
                    log_line(f"warning: {warning}")
            self.store.produce(self.step.entry, make, resumable=self.resumable, leftovers=("**/.*", *self.leftovers))
            if was_made:
                self._link_log()
            seconds = time.perf_counter() - started
            log_line(f"{self.step_name}: {f'done in {seconds:.1f} s' if was_made else MADE_ELSEWHERE}")

    def repair_if_damaged(self) -> None:
        """Verify the sha256 of all files of the result; quarantine a damaged result and make it again right away."""
        faults = self.store.verify(self.step.entry)
        if faults:
            log_line(f"{self.step_name}: damaged, made again: {faults[0]}")
            self.store.quarantine_if_damaged(self.step.entry)
            self.run()

    def _check_code(self) -> None:
        """Check that the code on the disk is that of the fingerprint, because tasks and Blender import it only now.

        Plugins are checked too: one that was loaded before an edit would store its results under the fingerprint of
        the edited one.

        Raises:
            ConfigError: code, a plugin or an input file has changed, or the kernels were compiled from other sources.
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
        """Check that weights, scans and the like, which may be read hours after the plan, are those of the plan."""
        for path, digest in self.step.files:
            _check_file(path, digest)

    def _link_log(self) -> None:
        """Link the log into the result's folder, where possible. The manifest does not list it."""
        link = self.store.folder(self.step.entry) / LOG_NAME
        with suppress(OSError):
            link.unlink(missing_ok=True)
            try:
                link.hardlink_to(self.log)
            except OSError:  # a filesystem without hard links
                shutil.copyfile(self.log, link)

    def on_failure(self, exception: BaseException) -> Any:
        disk_message = disk_error_message(exception, self.store.root)
        reason = disk_message or f"{type(exception).__name__}: {exception}"
        report_failure(
            self, reason, bool(disk_message) or isinstance(exception, USER_ERRORS), temporary=bool(disk_message)
        )
        return super().on_failure(exception)

    def make(self, out: Path) -> None:
        """Write the step's files into `out`."""
        raise NotImplementedError

    def upstream_folders(self, stage: str) -> list[Path]:
        """Result folders of those upstream steps that belong to `stage`, in the plan's order."""
        entries = [self.steps[name].entry for name in self.step.upstream]
        return [self.store.folder(entry) for entry in entries if entry.stage == stage]

    def mesh_path(self, mesh: MeshInput | None = None) -> Path:
        """File of a mesh, by default of the step's own; the content of a user's file is checked against the plan."""
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
    """The luigi task that makes a step's result."""
    classes: dict[str, type[StageTask]] = {task.stage: task for task in _iter_subclasses(StageTask)}
    return classes[step.entry.stage](
        step_name=step.name, fingerprint=step.entry.fingerprint, workspace=workspace, source=source
    )


def _iter_subclasses(task_class: type[StageTask]) -> Iterator[type[StageTask]]:
    for subclass in task_class.__subclasses__():
        yield subclass
        yield from _iter_subclasses(subclass)


def report_failure(task: StageTask, reason: str, brief: bool = False, *, temporary: bool = False) -> None:
    """Print the end of a failed task's log, unless `brief`, and then one line with the reason."""
    lines = [] if brief else last_lines(task.log)
    if lines:
        log_line("\n".join(f"    {line}" for line in lines))
    first = next((line for line in reason.splitlines() if line.strip()), reason).rstrip(" :")
    log_hint = "" if temporary else f"; log: {task.log}"
    record_failure(f"FAILED {task.step_name}: {first}{log_hint}", temporary=temporary)


@contextmanager
def reporting_broken(task: luigi.Task) -> Iterator[None]:
    """Report an error of ``complete()``, after which luigi skips the task, and raise it again."""
    try:
        yield
    except Exception as error:
        report_broken_task(task, error)
        raise


@luigi.Task.event_handler(luigi.Event.BROKEN_TASK)
def report_broken_task(task: luigi.Task, exception: BaseException) -> None:
    """Report why a task cannot be planned: in one line for `USER_ERRORS` and errors of files, else with a traceback."""
    root = getattr(task, "workspace", None)
    disk_message = disk_error_message(exception, Path(absolute_path(root)) if root else None)
    if disk_message is None and not isinstance(exception, (*USER_ERRORS, OSError)):
        log_line("".join(traceback.format_exception(exception)))
    name = getattr(task, "step_name", task.task_family)
    record_failure(f"FAILED {name}: {disk_message or exception}", temporary=bool(disk_message))


@luigi.Task.event_handler(luigi.Event.PROCESS_FAILURE)
def _report_task_death(task: luigi.Task, reason: str) -> None:
    """Report that a task's process was killed or crashed; runs in the process that started it."""
    if isinstance(task, StageTask):
        report_failure(task, f"its process died: {reason.partition('died ')[2] or reason}")
