"""The Ablations task: trains and evaluates every variant of a base config, and compares them."""

from __future__ import annotations

import luigi

from z2p_renderer.workflows.ablation.plan import COMPARE, AblationPlan, load_ablation_plan
from z2p_renderer.workflows.plan_task import PlanTask
from z2p_renderer.workflows.sources import ablation_source, variant_source

RESULTS = ("ablations.md", "ablations.csv", "ablations.json", "curves.png")


class Ablations(PlanTask):
    """A training run of equal budget for each variant; the comparison is linked in ``<workspace>/<config name>/``."""

    config = luigi.Parameter(default="", description="TOML file of base and variants; default: configs/ablations.toml")
    meshes = luigi.Parameter(default="", description="folder of meshes to train on; default: built-in shapes")
    evaluate_meshes = luigi.Parameter(default="", description="folder of meshes kept aside to measure quality on")

    linked_files = dict.fromkeys(RESULTS, COMPARE)

    @property
    def source(self) -> str:
        return ablation_source(self.config, self.meshes, self.evaluate_meshes)

    @property
    def plan(self) -> AblationPlan:
        return load_ablation_plan(self.source)

    def step_source(self, name: str) -> str:
        return self.source if name == COMPARE else variant_source(self.source, self.plan.variant_of[name])
