"""The PaperReport task: makes the report on the paper's evaluation."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module

import luigi

from z2p_renderer.workflows.plan_task import PlanTask
from z2p_renderer.workflows.process.task_log import log_line
from z2p_renderer.workflows.report.plan import ReportPlan, load_report_plan
from z2p_renderer.workflows.sources import report_source

RESULTS = ("report.html", "report.json", "report.csv")
SHARED_IMPORTS = ("torch", "kornia.metrics", "flip_evaluator", "open3d",
                  "z2p_renderer.pipeline.evaluation.paper.measure")  # fmt: skip
"""Modules that take long to import and that every measuring task needs."""


class PaperReport(PlanTask):
    """Every method on every sweep, in one page, which is linked in ``<workspace>/<config name>/``."""

    config = luigi.Parameter(default="", description="TOML file; without one, the whole report")
    meshes = luigi.Parameter(default="", description="folder of meshes never trained on; default: built-in shapes")
    scans = luigi.Parameter(default="", description="folder of scans to show beside the baselines")
    weights = luigi.Parameter(default="", description="comma-separated names or files; default: all that are shipped")
    sweeps = luigi.Parameter(default="", description="comma-separated sweeps; default: all of the config's")

    linked_files = dict.fromkeys(RESULTS, "report")

    @property
    def source(self) -> str:
        return report_source(self.config, self.meshes, self.scans, self.weights, self.sweeps)

    @property
    def plan(self) -> ReportPlan:
        return load_report_plan(self.source)

    def prepare(self) -> None:
        """Import `SHARED_IMPORTS` once, before the tasks' processes are forked."""
        for name in SHARED_IMPORTS:
            with suppress(ImportError, OSError):  # the task that needs the module reports the error
                import_module(name)

    def print_results(self) -> None:
        """Repeat the plan's warnings, then print the paths of the linked results."""
        for warning in self.plan.warnings:
            log_line(f"warning: {warning}")
        super().print_results()
