"""The luigi task that compares the variants of Ablations. FullPipeline's tasks train and evaluate each of them."""

from __future__ import annotations

from pathlib import Path

from z2p_renderer.workflows.ablation.plan import load_ablation_plan
from z2p_renderer.workflows.sources import variant_source
from z2p_renderer.workflows.stage_task import StageTask, create_task


class Compare(StageTask):
    """The table and the curves of all variants."""

    stage = "compare"

    def requires(self) -> list[StageTask]:
        plan = load_ablation_plan(self.source)
        return [create_task(plan.steps[name], variant_source(self.source, plan.variant_of[name]), self.workspace)
                for name in self.step.upstream]  # fmt: skip

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.evaluation.ablation.page import write_ablations

        plan = load_ablation_plan(self.source)
        folders = {name: (self._folder("train", name), self._folder("evaluate", name)) for name in plan.plans}
        write_ablations(plan.config, folders, plan.command, out)

    def _folder(self, stage: str, variant: str) -> Path:
        return self.store.folder(self.steps[f"{stage}/{variant}"].entry)
