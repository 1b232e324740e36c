"""What the tasks of the report on the paper's evaluation have in common."""

from __future__ import annotations

from pathlib import Path

from workflows.report_plan import ReportPlan, ReportStep, load_report_plan
from workflows.tasks import StageTask


class ReportTask(StageTask):
    """What the report's tasks share; no stage of its own."""

    @property
    def report(self) -> ReportPlan:
        """The plan that the task is a step of."""
        return load_report_plan(self.source)

    @property
    def part(self) -> ReportStep:
        """The task's step, with sweep and method."""
        return self.report.steps[self.step.name]

    @property
    def truth(self) -> Path:
        """The store of ground truth, which evaluations share."""
        return self.store.root / "truth"
