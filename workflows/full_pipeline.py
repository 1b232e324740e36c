"""FullPipeline: the goal that makes weights, from meshes to metrics."""

from __future__ import annotations

import luigi

from z2p_renderer.workflows.plan import AnyPlan
from z2p_renderer.workflows.plan_loading import load_pipeline_plan
from z2p_renderer.workflows.plan_task import PlanTask
from z2p_renderer.workflows.sources import pipeline_source

RESULTS = {
    "weights.safetensors": "train",
    "curve.png": "train",
    "metrics.json": "evaluate",
    "sheet.png": "evaluate",
}
"""What a user looks for at the end, and the step that makes it."""


class FullPipeline(PlanTask):
    """Everything from meshes to weights, picture and metrics; leaves them in ``<workspace>/<config name>/``."""

    config = luigi.Parameter(default="", description="TOML file; without one, the quick configuration")
    meshes = luigi.Parameter(default="", description="folder of meshes to train on; default: built-in shapes")
    evaluate_meshes = luigi.Parameter(default="", description="folder of meshes kept aside to measure quality on")

    shown = RESULTS

    @property
    def source(self) -> str:
        """Where config and meshes come from."""
        return pipeline_source(self.config, self.meshes, self.evaluate_meshes)

    @property
    def plan(self) -> AnyPlan:
        return load_pipeline_plan(self.source)
