"""Measures how rendering scales over workers of a central scheduler: ``python benchmarks/scaling.py [VIEWS]``.

Prints images an hour for one and for two workers on this machine, the scheduler's calls a task, and the bytes a render.
The pictures are tiny, so this measures mostly the start of Blender and the engine: the worst case.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "workflows"))

from world import CONFIG, World

VIEWS_PER_CHUNK = 4


def main(views: int) -> None:
    """A line for one and for two workers."""
    for workers in (1, 2):
        with tempfile.TemporaryDirectory(prefix="z2p-scaling-") as place:
            world = World(Path(place), code=False)
            (world.root / "small.toml").write_text(
                CONFIG.replace("views = 2\nchunk = 2", f"views = {views}\nchunk = {VIEWS_PER_CHUNK}")
            )
            print(measure(world, workers))


def measure(world: World, workers: int) -> str:
    """Runs `workers` pipelines of one worker each; returns a line with their speed."""
    world.scheduler = 8299
    log = world.root / "luigid.log"
    command = [sys.executable, "-m", "workflows", "scheduler", "--port", str(world.scheduler)]
    with log.open("w") as file:
        server = subprocess.Popen(command, cwd=world.root, env=world.environment, stdout=file, stderr=file)
    try:
        time.sleep(3)
        pipelines = [world.start() for _ in range(workers)]
        seconds, renders = watch(world, pipelines)
        output = [pipeline.communicate()[1] for pipeline in pipelines]
    finally:
        server.terminate()
        server.wait()
    if any(pipeline.returncode for pipeline in pipelines):
        raise SystemExit("".join(output))
    calls = Counter(line.split("/api/")[1].split()[0].split("?")[0] for line in log.read_text().splitlines()
                    if "/api/" in line)  # fmt: skip
    manifests = [json.loads(path.read_text()) for path in world.workspace.glob("[!.]*/*/manifest.json")]
    sizes = [sum(one["size"] for one in manifest["files"].values()) for manifest in manifests
             if manifest["name"].startswith("render/")]  # fmt: skip
    tasks = len(manifests) + 1
    return (
        f"{workers} workers: {renders} images in {seconds:.1f} s, {renders / seconds * 3600:.0f} an hour; "
        f"{sum(calls.values())} scheduler calls for {tasks} tasks ({dict(calls.most_common(4))}); "
        f"{sum(sizes) / renders:.0f} bytes a render"
    )


def watch(world: World, pipelines: list[subprocess.Popen]) -> tuple[float, int]:
    """Seconds from the first chunk's start to the last one's end, and how many views there are then."""
    logs = world.workspace / ".logs" / "render"
    while not list(logs.glob("*.log")) and any(pipeline.poll() is None for pipeline in pipelines):
        time.sleep(0.02)
    began = time.monotonic()
    chunks = int(world.workflows("status", "--json", *world.options).stdout.count('"stage": "render"'))
    while len(list(world.workspace.glob("render/*/manifest.json"))) < chunks:
        if all(pipeline.poll() is not None for pipeline in pipelines):
            break
        time.sleep(0.02)
    return time.monotonic() - began, len(list(world.workspace.glob("render/*/view_*.json")))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 24)
