"""The base of the tasks that users start: it requires every step of a plan, and links the results at the end."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import luigi

from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.plan import USER_ERRORS, AnyPlan
from z2p_renderer.workflows.process.explain import explain
from z2p_renderer.workflows.process.progress import start_progress
from z2p_renderer.workflows.process.signals import handle_termination
from z2p_renderer.workflows.process.task_log import log_line
from z2p_renderer.workflows.sources import absolute_path
from z2p_renderer.workflows.stage_task import StageTask, create_task, report_broken_task, reporting_broken
from z2p_renderer.workflows.upkeep.result_links import are_linked, link_results


class PlanTask(luigi.Task):
    """Makes every result of a plan, and links those for users in ``<workspace>/<config name>/``."""

    config = luigi.Parameter(default="", description="TOML file; without one, the goal's own")
    meshes = luigi.Parameter(default="", description="folder of meshes; default: built-in shapes")
    workspace = luigi.Parameter(default="runs", description="folder of all results")

    explain = luigi.BoolParameter(default=False, significant=False, description="say first why each stage runs")
    dry_run = luigi.BoolParameter(default=False, significant=False, description="say what would run; write nothing")

    linked_files: ClassVar[Mapping[str, str]] = {}
    """Files to link for users: file name -> name of the step that makes it."""

    @property
    def source(self) -> str:
        """The plan's source (see `workflows.sources`), from which other processes compute the plan again."""
        raise NotImplementedError

    @property
    def plan(self) -> AnyPlan:
        """The plan whose results the task requires."""
        raise NotImplementedError

    @property
    def store(self) -> Store:
        return Store(Path(absolute_path(self.workspace)))

    def step_source(self, name: str) -> str:
        """The source for the task of the named step."""
        return self.source

    def requires(self) -> list[StageTask]:
        # every step, not only the last: a deleted result is made again even if the results downstream exist
        root = str(self.store.root)
        return [create_task(step, self.step_source(name), root) for name, step in self.plan.steps.items()]

    def complete(self) -> bool:
        try:
            if self.explain or self.dry_run:
                explain(self, self.plan, self.store, dry_run=self.dry_run)
            tasks = self.requires()
        except USER_ERRORS:
            return False  # luigi calls requires() next, and that error is reported in one line
        if self.dry_run:
            return True  # luigi then runs nothing
        with reporting_broken(self):
            if all(task.complete() for task in tasks):
                return are_linked(self.results())
            start_progress(self.store, self.plan, self.source)
        handle_termination()
        self.prepare()
        return False

    def prepare(self) -> None:
        """Called once before luigi forks a process for each task; imports done here are shared by all of them."""

    def run(self) -> None:
        link_results(self.results())

    def results(self) -> dict[Path, Path]:
        """Path under ``<workspace>/<config name>/`` -> the file in the store that it leads to."""
        plan, folder = self.plan, self.store.root / self.plan.config.name
        return {
            folder / name: self.store.folder(plan.steps[step].entry) / name
            for name, step in self.linked_files.items()
        }

    def on_failure(self, exception: BaseException) -> Any:
        report_broken_task(self, exception)
        return super().on_failure(exception)

    def print_results(self) -> None:
        """Print the paths of the linked results."""
        for path in self.results():
            log_line(f"{path.name:20} {path}")


@PlanTask.event_handler(luigi.Event.SUCCESS)
def _print_results_on_success(task: PlanTask) -> None:
    task.print_results()


@PlanTask.event_handler(luigi.Event.DEPENDENCY_PRESENT)
def _print_results_if_complete(task: PlanTask) -> None:
    if not task.dry_run:
        log_line("everything is up to date")
        task.print_results()
