"""PaperReport: the goal that makes the report on the paper's evaluation."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module

import luigi

from z2p_renderer.workflows.plan_task import PlanTask
from z2p_renderer.workflows.process.task_log import log_line
from z2p_renderer.workflows.report.plan import ReportPlan, load_report_plan
from z2p_renderer.workflows.sources import report_source

RESULTS = ("report.html", "report.json", "report.csv")


class PaperReport(PlanTask):
    """Every method on every sweep, in one page; leaves it in ``<workspace>/<config name>/``."""

    config = luigi.Parameter(default="", description="TOML file; without one, the whole report")
    meshes = luigi.Parameter(default="", description="folder of meshes never trained on; default: built-in shapes")
    scans = luigi.Parameter(default="", description="folder of scans to show beside the baselines")
    weights = luigi.Parameter(default="", description="comma-separated names or files; default: all that are shipped")
    sweeps = luigi.Parameter(default="", description="comma-separated sweeps; default: all of the config's")

    shown = dict.fromkeys(RESULTS, "report")

    @property
    def source(self) -> str:
        """Where config, meshes, scans and weights come from."""
        return report_source(self.config, self.meshes, self.scans, self.weights, self.sweeps)

    @property
    def plan(self) -> ReportPlan:
        return load_report_plan(self.source)

    def prepare(self) -> None:
        """Import what every measuring task needs."""
        for name in ("torch", "kornia.metrics", "flip_evaluator", "open3d", "z2p_renderer.pipeline.evaluation.paper.measure"):
            with suppress(ImportError, OSError):  # the task that needs it says so
                import_module(name)

    def print_results(self) -> None:
        """Say once more what the plan warned of, then where the results are."""
        for warning in self.plan.warnings:
            log_line(f"warning: {warning}")
        super().print_results()
