"""What users start: a task that needs every step of a plan, and shows where the results are."""

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
    """All that a plan holds; leaves what a user looks for in ``<workspace>/<config name>/``."""

    config = luigi.Parameter(default="", description="TOML file; without one, the goal's own")
    meshes = luigi.Parameter(default="", description="folder of meshes; default: built-in shapes")
    workspace = luigi.Parameter(default="runs", description="folder of all results")

    explain = luigi.BoolParameter(default=False, significant=False, description="say first why each stage runs")
    dry_run = luigi.BoolParameter(default=False, significant=False, description="say what would run; write nothing")

    shown: ClassVar[Mapping[str, str]] = {}
    """What a user looks for at the end: name of a file, and the step that makes it."""

    @property
    def source(self) -> str:
        """Where config, meshes and whatever else the plan depends on come from, for other processes."""
        raise NotImplementedError

    @property
    def plan(self) -> AnyPlan:
        raise NotImplementedError

    @property
    def store(self) -> Store:
        return Store(Path(absolute_path(self.workspace)))

    def step_source(self, name: str) -> str:
        """The source that the step's own task is made with."""
        return self.source

    def requires(self) -> list[StageTask]:
        # every step, not only the last: results that were deleted are made again even if what follows is there
        root = str(self.store.root)
        return [create_task(step, self.step_source(name), root) for name, step in self.plan.steps.items()]

    def complete(self) -> bool:
        try:
            if self.explain or self.dry_run:
                explain(self, self.plan, self.store, dry_run=self.dry_run)
            tasks = self.requires()
        except USER_ERRORS:
            return False  # luigi calls requires() next, whose error is told in one line
        if self.dry_run:
            return True  # so that luigi does nothing
        with reporting_broken(self):
            if all(task.complete() for task in tasks):
                return are_linked(self.results())
            start_progress(self.store, self.plan, self.source)
        handle_termination()
        self.prepare()
        return False

    def prepare(self) -> None:
        """What is worth doing once, before luigi gives each task a process that is a copy of this one."""

    def run(self) -> None:
        link_results(self.results())

    def results(self) -> dict[Path, Path]:
        """Path under ``<workspace>/<config name>/`` -> the file in the store that it leads to."""
        plan, folder = self.plan, self.store.root / self.plan.config.name
        return {
            folder / name: self.store.folder(plan.steps[step].entry) / name for name, step in self.shown.items()
        }

    def on_failure(self, exception: BaseException) -> Any:
        report_broken_task(self, exception)
        return super().on_failure(exception)

    def print_results(self) -> None:
        """Say where the results are."""
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
