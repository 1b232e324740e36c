"""Times the workflow engine when there is nothing to do: ``python benchmarks/workflow_engine.py``.

Prints the seconds that `complete()` takes over 1,000 tasks, and those of a whole fresh `luigi ... FullPipeline`, from
the start of the process to its end. The stored results are dummies; the meshes are files of 1 MB.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.full_pipeline import RESULTS
from z2p_renderer.workflows.plan import Step
from z2p_renderer.workflows.plan_loading import load_pipeline_plan
from z2p_renderer.workflows.sources import pipeline_source
from z2p_renderer.workflows.stage_task import create_task

MESHES, VIEWS, CHUNK = 112, 70, 10
"""With a sample, a shard and seven chunks of renders a mesh: 1,010 tasks."""


def main() -> None:
    """Print both figures."""
    with tempfile.TemporaryDirectory(prefix="z2p-benchmark-") as place:
        os.chdir(place)
        _make_inputs()
        source = pipeline_source("engine.toml", "meshes", "kept")
        plan, store = load_pipeline_plan(source), Store(Path("runs").absolute())
        for step in plan.steps.values():
            store.produce(step.entry, lambda folder, step=step: _fill(folder, step))
        tasks = [create_task(step, source, str(store.root)) for step in plan.steps.values()]
        started = time.perf_counter()
        assert all(task.complete() for task in tasks)
        seconds = time.perf_counter() - started
        print(f"complete() over {len(tasks)} tasks: {seconds:.2f} s, {seconds / len(tasks) * 1e3:.2f} ms a task")
        for when in ("the first, which links the results", "a fresh one"):
            started = time.perf_counter()
            output = _run()
            print(f"FullPipeline, {when}: {time.perf_counter() - started:.2f} s")
        assert "everything is up to date" in output


def _make_inputs() -> None:
    for folder, count in (("meshes", MESHES), ("kept", 1)):
        Path(folder).mkdir()
        for number in range(count):
            Path(folder, f"mesh{number}.ply").write_bytes(f"{folder} {number}".encode() + bytes(2**20))
    Path("engine.toml").write_text(f'name = "engine"\n[render]\nviews = {VIEWS}\nchunk = {CHUNK}\n')


def _fill(folder: Path, step: Step) -> None:
    """As many files as the stage writes: four a view."""
    kinds = ("png", "json", "coverage.png", "passes.npz")
    names = [f"view_{view:05d}.{kind}" for view in range(*step.views) for kind in kinds]
    for name in names or [name for name, stage in RESULTS.items() if stage == step.entry.stage] or ["result.bin"]:
        (folder / name).write_text(step.name)


def _run() -> str:
    command = [sys.executable, "-m", "luigi", "--module", "workflows", "FullPipeline", "--local-scheduler",
               "--config", "engine.toml", "--meshes", "meshes", "--evaluate-meshes", "kept"]  # fmt: skip
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    return result.stderr


if __name__ == "__main__":
    main()
