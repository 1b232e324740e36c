"""The common base of the report's tasks."""

from __future__ import annotations

from pathlib import Path

from z2p_core.config import ConfigError
from z2p_renderer.pipeline.evaluation.paper.methods import method_fields
from z2p_renderer.workflows.report.plan import ReportPlan, ReportStep, load_report_plan
from z2p_renderer.workflows.stage_task import StageTask


class ReportTask(StageTask):
    """Base class of the report's tasks; abstract, without a stage."""

    @property
    def report(self) -> ReportPlan:
        """The plan that the task is a step of."""
        return load_report_plan(self.source)

    @property
    def part(self) -> ReportStep:
        """The task's step, as the report's plan has it: with sweep and method."""
        return self.report.steps[self.step.name]

    def _check_code(self) -> None:
        """As for every task; also checks that the method's weights or plugin are those of the plan."""
        super()._check_code()
        method = self.part.method
        if method is not None and method_fields(method) != self.part.entry.fields["method"]:
            raise ConfigError(f"{self.step_name}: {method.name} changed since the report started; start it again")

    @property
    def truth(self) -> Path:
        """Folder of the store of ground truth, which all evaluations share."""
        return self.store.root / "truth"
