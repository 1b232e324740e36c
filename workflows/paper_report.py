"""PaperReport: the task that makes the report on the paper's evaluation, as FullPipeline makes weights."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module
from pathlib import Path

import luigi

from storage.layout import Store
from workflows.explaining import explain
from workflows.links import link, linked
from workflows.plan import USERS_ERRORS
from workflows.progress import watch
from workflows.report_plan import ReportPlan, load_report_plan, report_source
from workflows.task_log import say
from workflows.tasks import StageTask, absolute, task_of

RESULTS = ("report.html", "report.json", "report.csv")


class PaperReport(luigi.Task):
    """Every method on every sweep, in one page; leaves it in ``<workspace>/<config name>/``."""

    config = luigi.Parameter(default="", description="TOML file; without one, the whole report")
    meshes = luigi.Parameter(default="", description="folder of meshes never trained on; default: built-in shapes")
    scans = luigi.Parameter(default="", description="folder of scans to show beside the baselines")
    weights = luigi.Parameter(default="", description="comma-separated names or files; default: all that are shipped")
    sweeps = luigi.Parameter(default="", description="comma-separated sweeps; default: all of the config's")
    workspace = luigi.Parameter(default="runs", description="folder of all results")

    explain = luigi.BoolParameter(default=False, significant=False, description="say first why each stage runs")
    dry_run = luigi.BoolParameter(default=False, significant=False, description="say what would run; write nothing")

    @property
    def source(self) -> str:
        """Where config, meshes, scans and weights come from."""
        return report_source(self.config, self.meshes, self.scans, self.weights, self.sweeps)

    @property
    def plan(self) -> ReportPlan:
        return load_report_plan(self.source)

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
        _import_libraries()
        return False

    def run(self) -> None:
        link(self.results())

    def results(self) -> dict[Path, Path]:
        """Path under ``<workspace>/<config name>/`` -> the file in the store that it leads to."""
        folder = self.store.folder(self.plan.steps["report"].entry)
        return {self.store.root / self.plan.config.name / name: folder / name for name in RESULTS}


def _import_libraries() -> None:
    """Import what every measuring task needs, once: luigi gives each task a process that is a copy of this one."""
    for name in ("torch", "kornia.metrics", "flip_evaluator", "open3d", "pipeline.paper.measure"):
        with suppress(ImportError):  # the task that needs it says so
            import_module(name)


@PaperReport.event_handler(luigi.Event.SUCCESS)
def _tell_results(task: PaperReport) -> None:
    for warning in task.plan.warnings:
        say(f"warning: {warning}")
    for path in task.results():
        say(f"{path.name:20} {path}")


@PaperReport.event_handler(luigi.Event.DEPENDENCY_PRESENT)
def _tell_found(task: PaperReport) -> None:
    if task.dry_run:
        return
    say("everything is up to date")
    _tell_results(task)
