"""FullPipeline: the task that a user starts; it needs every step of the plan and shows where the results are."""

from __future__ import annotations

import json
import os
import traceback
from pathlib import Path

import luigi

from storage.layout import Store
from workflows.plan import USERS_ERRORS
from workflows.tasks import StageTask, load_plan, say, task_of

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

    @property
    def source(self) -> str:
        """Where config and meshes come from, as JSON with absolute paths: all that another process needs."""
        return json.dumps({key: self._absolute(key) for key in ("config", "meshes", "evaluate_meshes")})

    def requires(self) -> list[StageTask]:
        # every step, not only the last: results that were deleted are made again even if what follows is there
        plan = load_plan(self.source)
        return [task_of(step, self.source, self._absolute("workspace")) for step in plan.steps.values()]

    def complete(self) -> bool:
        try:
            tasks = self.requires()
        except USERS_ERRORS:
            return False  # luigi calls requires() next, whose error is told in one line
        if not all(task.complete() for task in tasks):
            return False
        return all(shown.is_symlink() and shown.resolve() == found for shown, found in self.results().items())

    def run(self) -> None:
        for shown, found in self.results().items():
            shown.parent.mkdir(parents=True, exist_ok=True)
            link = shown.with_name(f".{shown.name}.{os.getpid()}")
            link.unlink(missing_ok=True)
            link.symlink_to(os.path.relpath(found, shown.parent))
            link.replace(shown)

    def results(self) -> dict[Path, Path]:
        """Path under ``<workspace>/<config name>/`` -> the file in the store that it leads to."""
        plan = load_plan(self.source)
        store = Store(Path(self._absolute("workspace")))
        shown = store.root / plan.config.name
        return {
            shown / name: (store.folder(plan.steps[stage].entry) / name).resolve() for name, stage in RESULTS.items()
        }

    def _absolute(self, parameter: str) -> str:
        value = getattr(self, parameter)
        return value if value in ("", "builtin") else str(Path(value).absolute())


@FullPipeline.event_handler(luigi.Event.SUCCESS)
def _tell_results(task: FullPipeline) -> None:
    for path in task.results():
        say(f"{path.name:20} {path}")


@FullPipeline.event_handler(luigi.Event.DEPENDENCY_PRESENT)
def _tell_found(task: FullPipeline) -> None:
    say("everything is up to date")
    _tell_results(task)


@luigi.Task.event_handler(luigi.Event.BROKEN_TASK)
def _tell_broken(task: luigi.Task, exception: BaseException) -> None:
    """Say why a task cannot even be planned: one line for what a user can mend, everything for the rest."""
    if not isinstance(exception, USERS_ERRORS):
        say("".join(traceback.format_exception(exception)))
    say(f"FAILED {getattr(task, 'step_name', task.task_family)}: {exception}")
