"""A small world that whole pipelines run in: a copy of the code, meshes, a config, a workspace; all may be edited.

Everything is real (Blender, HDF5, training), at the smallest size: 16 x 16 pictures of one sample a pixel.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

PROJECT = Path(__file__).parents[2]
FAULTS = Path(__file__).parent / "faults" / "injected"
"""Folder of the `sitecustomize` that injects faults into the Python processes of a pipeline."""
ROOMS = ("pipeline", "plugins", "storage", "workflows", "z2p_core", "z2p_renderer")

CONFIG = """name = "small"
[sample]
points = 200
[render]
views = 2
chunk = 2
resolution = 16
samples = 1
bounces = 1
[shard]
resolution = 16
[train]
steps = 4
batch = 2
warmup = 1
points = [100, 200]
validate_every = 2
validation_share = 0.2
checkpoint_every = 2
[train.network]
widths = [8, 8]
mapping = 8
[evaluate]
views = 1
points = 100
resolution = 16
samples = 1
denoise = "off"
"""

TETRA = ([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])
PYRAMID = (
    [(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0), (0, 0, 2)],
    [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (0, 2, 1), (0, 3, 2)],
)
WEDGE = ([(0, 0, 0), (2, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])


def write_off(path: Path, vertices: list, faces: list) -> None:
    rows = [" ".join(map(str, row)) for row in [*vertices, *([len(face), *face] for face in faces)]]
    path.write_text("\n".join(["OFF", f"{len(vertices)} {len(faces)} 0", *rows]) + "\n")


class World:
    """A folder with everything that a pipeline needs; `run` starts it as a user does."""

    def __init__(self, root: Path, code: bool = True) -> None:
        self.root = root
        self.code = root / "code"
        self.workspace = root / "runs"
        self.cache = root.parent / "cache"
        """What stands for the user's cache folder; worlds beside each other share it."""
        self.scheduler: int | None = None
        """Port of a luigid; None for the local scheduler."""
        self.scheduler_address = "127.0.0.1"
        self.processes = 1
        """How many pipelines a run starts at the same time."""
        for name, mesh in (("meshes/tetra", TETRA), ("meshes/pyramid", PYRAMID), ("kept/wedge", WEDGE)):
            path = root / f"{name}.off"
            path.parent.mkdir(exist_ok=True, parents=True)
            write_off(path, *mesh)
        (root / "small.toml").write_text(CONFIG)
        for room in ROOMS if code else ():
            shutil.copytree(PROJECT / room, self.code / room, ignore=shutil.ignore_patterns("__pycache__"))

    @property
    def environment(self) -> dict[str, str]:
        path = self.code if self.code.exists() else PROJECT
        paths = os.pathsep.join(map(str, (path, FAULTS)))
        settings = {"PYTHONPATH": paths, "PYTHONSAFEPATH": "1", "OMP_NUM_THREADS": "1", "Z2P_CACHE": str(self.cache)}
        return {**os.environ, **settings}

    def command(self, *more: str) -> list[str]:
        if self.scheduler:
            url = f"http://{self.scheduler_address}:{self.scheduler}"
            z2p = [sys.executable, "-m", "z2p_renderer.pipeline.cli"]
            return [*z2p, "pipeline", "--scheduler", url, *self.options, *more]
        luigi = [sys.executable, "-m", "luigi", "--module", "workflows", "FullPipeline", "--local-scheduler"]
        return [*luigi, *self.options, *more]

    @property
    def options(self) -> list[str]:
        meshes = next(path for path in self.root.iterdir() if path.name.startswith("meshes"))
        return ["--config", "small.toml", "--meshes", meshes.name, "--evaluate-meshes", "kept",
                "--workspace", self.workspace.name]  # fmt: skip

    def start(self, *more: str, on: Callable[[list[str]], list[str]] = list, **environment: str) -> subprocess.Popen:
        """The pipeline as a process group of its own; `on` turns the words of a command into those for a host."""
        return subprocess.Popen(
            on(self.command(*more)), cwd=self.root, env=self.environment | environment, stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, text=True, start_new_session=True,
        )

    def run(self, *more: str, processes: int = 0, **environment: str) -> tuple[int, str]:
        """Highest exit status and everything that was said."""
        started = [self.start(*more, **environment) for _ in range(processes or self.processes)]
        said = [process.communicate()[1] for process in started]
        return max(process.returncode for process in started), "".join(said)

    def make(self, *more: str) -> list[str]:
        """Steps that a run made, each as often as it was made; the run must succeed."""
        status, said = self.run(*more)
        assert status == 0, said
        return made(said)

    def workflows(self, *words: str) -> subprocess.CompletedProcess:
        """`z2p status` and its like."""
        command = [sys.executable, "-m", "workflows", *words]
        return subprocess.run(command, cwd=self.root, env=self.environment, capture_output=True, text=True, check=False)

    def predicted(self) -> set[str]:
        """Steps that are not fresh, by `z2p status`."""
        result = self.workflows("status", "--stale", "--json", *self.options)
        assert result.returncode == 0, result.stderr
        return {row["step"] for row in json.loads(result.stdout)}

    def manifest(self, name: str) -> Path:
        """Manifest of a step's result under the present settings."""
        return self.manifests()[name]

    def manifests(self) -> dict[str, Path]:
        """Step -> manifest of its result under the present settings."""
        rows = json.loads(self.workflows("status", "--json", *self.options).stdout)
        return {
            row["step"]: self.workspace / row["stage"] / row["fingerprint"][:32] / "manifest.json" for row in rows
        }

    def digests(self) -> dict[str, str]:
        """File of a result -> its digest; without those that tell how long something took."""
        found: dict[str, str] = {}
        for path in sorted(self.workspace.glob("[!.]*/*/manifest.json")):
            manifest = json.loads(path.read_text())
            files = {name: record["sha256"] for name, record in manifest["files"].items() if name != "metrics.json"}
            found |= {f"{manifest['name']} {path.parent.name[:8]} {name}": digest for name, digest in files.items()}
        return found


def made(said: str) -> list[str]:
    return sorted(line.split(":")[0] for line in said.splitlines() if ": done in " in line)


@contextmanager
def luigid(world: World, port: int | None = None) -> Iterator[subprocess.Popen]:
    """A running central scheduler, which the world's pipelines use meanwhile."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        world.scheduler = port or free.getsockname()[1]
    address = world.scheduler_address
    command = [sys.executable, "-m", "workflows", "scheduler", "--address", address, "--port", str(world.scheduler)]
    server = subprocess.Popen(
        command, cwd=world.root, env=world.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        for _ in range(200):
            with socket.socket() as client:
                if client.connect_ex((address, world.scheduler)) == 0:
                    break
            time.sleep(0.1)
        yield server
    finally:
        world.scheduler = None
        server.terminate()
        server.wait()
