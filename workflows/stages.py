"""The luigi tasks: one class a stage, whose make() hands its paths to one function of `pipeline`."""

from __future__ import annotations

from pathlib import Path

from z2p_renderer.storage.results.fingerprints import RENDER_STAGES
from z2p_renderer.workflows.process.task_log import log_line
from z2p_renderer.workflows.stage_task import StageTask
from z2p_renderer.workflows.upkeep.reuse_views import copy_existing_views


class Shapes(StageTask):
    """The built-in meshes."""

    stage = "shapes"

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.shapes import make_shapes

        make_shapes(out)


class SampleMesh(StageTask):
    """A mesh's pool of points."""

    stage = "sample"
    priority = 10  # before the renders: a broken mesh shows in the first minute and not after hours

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.rendering.mesh_samples import sample_pool

        config = self.plan.config.sample
        sample_pool(self.mesh_path(), config, config.seed, out)


class RenderChunk(StageTask):
    """Some of a mesh's views; a killed one keeps what it has, and views rendered under another cut are copied."""

    stage = "render"
    resumable = True

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.rendering.views import render_chunk

        step = self.step
        if step.mesh is None:
            raise ValueError(f"{self.step_name} has no mesh")
        copy_existing_views(self.store, step.entry, range(*step.views), out)
        render_chunk(self.mesh_path(), step.mesh.identity, *step.views, self.plan.config.render, out, log=log_line)


class TexturedRenderChunk(StageTask):
    """The same of views of which some have textures."""

    stage = "textured_render"
    resumable = True

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.rendering.textured_views import render_textured_chunk

        step, config = self.step, self.plan.config.render
        if step.mesh is None:
            raise ValueError(f"{self.step_name} has no mesh")
        copy_existing_views(self.store, step.entry, range(*step.views), out)
        render_textured_chunk(self.mesh_path(), step.mesh.identity, *step.views, config, out, log=log_line)


class ShardMesh(StageTask):
    """A mesh's renders and points in one HDF5 file."""

    stage = "shard"

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.rendering.views import load_controls
        from z2p_renderer.pipeline.training.make_shard import make_shard

        config, mesh = self.plan.config, self.step.mesh
        pool = self.upstream_folders("sample")[0] / "pool.npy"
        controls = load_controls(config.render.controls)
        # told by its content, not by a name that may change while the shard stays
        identity = mesh.identity[:16] if mesh else ""
        renders = [folder for stage in RENDER_STAGES for folder in self.upstream_folders(stage)]
        make_shard(renders, pool, config.shard, controls, out, identity)


class Train(StageTask):
    """Weights and learning curve."""

    stage = "train"
    resumable = True
    leftovers = ("checkpoints",)

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.training.train import train

        steps = [self.plan.steps[name] for name in self.step.upstream]
        # by content: neither the meshes' names nor code that gives the same shards change the order that they are read
        steps.sort(key=lambda step: step.mesh.identity if step.mesh else "")
        shards = [self.store.folder(step.entry) / "shard.h5" for step in steps]
        train(shards, self.plan.config.train, out, log=log_line)


class Evaluate(StageTask):
    """Metrics and contact sheet against Blender's ground truth, on meshes kept aside."""

    stage = "evaluate"

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.evaluation.evaluate import evaluate

        weights = self.upstream_folders("train")[0] / "weights.safetensors"
        meshes = {mesh.name: self.mesh_path(mesh) for mesh in self.plan.evaluation}
        evaluate(meshes, weights, out, self.plan.config.evaluate, self.store.root / "truth", log=log_line)
