"""FullPipeline: the task that a user starts; it needs every step of the plan and shows where the results are."""

from __future__ import annotations

import traceback
from pathlib import Path

import luigi

from storage.layout import Store
from workflows.explaining import explain
from workflows.links import link, linked
from workflows.plan import USERS_ERRORS, Planned
from workflows.progress import watch
from workflows.task_log import say
from workflows.tasks import StageTask, absolute, load_plan, source_of, task_of

RESULTS = {
    "weights.safetensors": "train",
    "curve.png": "train",
    "metrics.json": "evaluate",
    "sheet.png": "evaluate",
}
"""What a user looks for at the end, and the stage that makes it."""


class FullPipeline(luigi.Task):
    """Everything from meshes to weights, picture and metrics; leaves them in ``<workspace>/<config name>/``."""

    config = luigi.Parameter(default="", description="TOML file; without one, the quick configuration")
    meshes = luigi.Parameter(default="", description="folder of meshes to train on; default: built-in shapes")
    evaluate_meshes = luigi.Parameter(default="", description="folder of meshes kept aside to measure quality on")
    workspace = luigi.Parameter(default="runs", description="folder of all results")

    explain = luigi.BoolParameter(default=False, significant=False, description="say first why each stage runs")
    dry_run = luigi.BoolParameter(default=False, significant=False, description="say what would run; write nothing")

    @property
    def source(self) -> str:
        """Where config and meshes come from."""
        return source_of(self.config, self.meshes, self.evaluate_meshes)

    @property
    def plan(self) -> Planned:
        return load_plan(self.source)

    @property
    def store(self) -> Store:
        return Store(Path(absolute(self.workspace)))

    def requires(self) -> list[StageTask]:
        # every step, not only the last: results that were deleted are made again even if what follows is there
        return [task_of(step, self.source, str(self.store.root)) for step in self.plan.steps.values()]

    def complete(self) -> bool:
        try:
            if self.explain or self.dry_run:
                explain(self, self.plan, self.store, dry_run=self.dry_run)
            tasks = self.requires()
        except USERS_ERRORS:
            return False  # luigi calls requires() next, whose error is told in one line
        if self.dry_run:
            return True  # so that luigi does nothing
        if all(task.complete() for task in tasks):
            return linked(self.results())
        watch(self.store, self.plan, self.source)
        return False

    def run(self) -> None:
        link(self.results())

    def results(self) -> dict[Path, Path]:
        """Path under ``<workspace>/<config name>/`` -> the file in the store that it leads to."""
        plan = self.plan
        shown = self.store.root / plan.config.name
        return {
            shown / name: self.store.folder(plan.steps[stage].entry) / name for name, stage in RESULTS.items()
        }


@FullPipeline.event_handler(luigi.Event.SUCCESS)
def _tell_results(task: FullPipeline) -> None:
    for path in task.results():
        say(f"{path.name:20} {path}")


@FullPipeline.event_handler(luigi.Event.DEPENDENCY_PRESENT)
def _tell_found(task: FullPipeline) -> None:
    if task.dry_run:
        return
    say("everything is up to date")
    _tell_results(task)


@luigi.Task.event_handler(luigi.Event.BROKEN_TASK)
def _tell_broken(task: luigi.Task, exception: BaseException) -> None:
    """Say why a task cannot even be planned: one line for what a user can mend, everything for the rest."""
    if not isinstance(exception, USERS_ERRORS):
        say("".join(traceback.format_exception(exception)))
    say(f"FAILED {getattr(task, 'step_name', task.task_family)}: {exception}")
