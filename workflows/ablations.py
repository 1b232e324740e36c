"""Ablations: the task that trains and measures every variant of a base, and shows them side by side."""

from __future__ import annotations

from pathlib import Path

import luigi

from workflows.ablation_plan import COMPARE, AblationPlan, ablation_source, load_ablation_plan, variant_source
from workflows.full_pipeline import FullPipeline
from workflows.tasks import StageTask, task_of

RESULTS = ("ablations.md", "ablations.csv", "ablations.json", "curves.png")


class Ablations(FullPipeline):
    """One training run of equal budget for each variant; leaves the comparison in ``<workspace>/<config name>/``."""

    config = luigi.Parameter(default="", description="TOML file of base and variants; default: configs/ablations.toml")

    @property
    def source(self) -> str:
        return ablation_source(self.config, self.meshes, self.evaluate_meshes)

    @property
    def plan(self) -> AblationPlan:
        return load_ablation_plan(self.source)

    def requires(self) -> list[StageTask]:
        # every step, not only the last: results that were deleted are made again even if what follows is there
        plan, root = self.plan, str(self.store.root)
        return [
            task_of(step, variant_source(self.source, plan.variant_of[name]) if name != COMPARE else self.source, root)
            for name, step in plan.steps.items()
        ]

    def results(self) -> dict[Path, Path]:
        """Path under ``<workspace>/<config name>/`` -> the file in the store that it leads to."""
        folder = self.store.folder(self.plan.steps[COMPARE].entry)
        return {self.store.root / self.plan.config.name / name: folder / name for name in RESULTS}
