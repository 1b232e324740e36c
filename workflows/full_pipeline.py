"""The FullPipeline task: from meshes to weights and metrics."""

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
"""File -> the step that makes it; linked under the config's name at the end."""


class FullPipeline(PlanTask):
    """Weights, learning curve, metrics and contact sheet, linked in ``<workspace>/<config name>/``."""

    config = luigi.Parameter(default="", description="TOML file; without one, the quick configuration")
    meshes = luigi.Parameter(default="", description="folder of meshes to train on; default: built-in shapes")
    evaluate_meshes = luigi.Parameter(default="", description="folder of meshes kept aside to measure quality on")

    linked_files = RESULTS

    @property
    def source(self) -> str:
        return pipeline_source(self.config, self.meshes, self.evaluate_meshes)

    @property
    def plan(self) -> AnyPlan:
        return load_pipeline_plan(self.source)
