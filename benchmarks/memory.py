"""Memory of a long run and of a huge cloud: ``python benchmarks/memory.py``.

Draws ``--pictures`` small pictures in one process and records its memory, and a cloud of ``--points`` through `z2p
run-inference`. Prints a table, and writes ``memory.json`` and the curve ``memory.png`` to --output.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from inputs import make_cloud

from z2p_core.meshes.synthetic_noise import add_noise
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.images.image_files import encode_picture

PAGE_BYTES = resource.getpagesize()
LONG_RUN_LIMIT = 600.0
"""Peak memory of a long run, MB."""
HUGE_CLOUD_LIMIT = 1000.0
"""Peak memory of a process that reads a huge cloud, without the file, MB."""
GROWTH_LIMIT = 5.0
"""Growth of the mean memory from the first half of a long run to the second, MB."""
SIDES = (64, 96)
"""Sides of the small pictures, chosen at random."""
POINTS = (200, 2000)
"""Fewest and most points of their clouds."""
READINGS = 200
"""Readings of the memory in a long run."""
POINTS_PER_WRITE = 2_000_000
"""Points of the huge cloud written at a time."""


def main() -> None:
    """Measure, print and write everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", default="regular", help="name or file")
    parser.add_argument("--pictures", type=int, default=10_000)
    parser.add_argument("--points", type=float, default=1e8, help="of the huge cloud (1e8: 1.2 GB on disk)")
    parser.add_argument("--output", type=Path, default=Path("previews/benchmarks"))
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    rows = [*long_run(options), huge_cloud(options)]
    print("| what | MB | limit |\n|---|--:|--:|")
    for row in rows:
        print(f"| {row['what']} | {row['MB']:.1f}{' !' if row['MB'] > row['limit'] else ''} | {row['limit']:.0f} |")
    (options.output / "memory.json").write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    print(f"\nwrote {options.output / 'memory.json'} and memory.png beside it")


def long_run(options: Any) -> list[dict[str, Any]]:
    """Peak and growth of this process's memory over many pictures of random clouds, light and colour."""
    renderer, rng = Renderer(options.weights, threads=1), np.random.default_rng(0)
    base, curve, began = make_cloud(POINTS[1]), [], time.perf_counter()
    every = max(1, options.pictures // READINGS)
    for number in range(options.pictures):
        side, count = int(rng.choice(SIDES)), int(rng.integers(*POINTS))
        values = {name: control.draw(rng) for name, control in renderer.controls.items()}
        cloud = add_noise(base[:count], "gaussian", 0.01, rng)
        encode_picture(renderer.render(cloud, values, side, side), ".png", record={"record": 1, "number": number})
        if number % every == 0:
            curve.append((number, _resident_megabytes()))
    at, megabytes = zip(*curve, strict=True)
    _draw(options.output / "memory.png", at, megabytes)
    steady = np.array(megabytes[len(megabytes) // 10 :])  # the first pictures fill caches
    halves = np.array_split(steady, 2)
    growth = float(halves[1].mean() - halves[0].mean())
    what = f"{options.pictures} pictures"
    return [
        {"what": f"{what}: most memory of the process", "MB": max(megabytes), "limit": LONG_RUN_LIMIT, "curve": curve,
         "seconds": time.perf_counter() - began},
        {"what": f"{what}: growth from the first half to the second", "MB": growth, "limit": GROWTH_LIMIT},
    ]  # fmt: skip


def huge_cloud(options: Any) -> dict[str, Any]:
    """Peak memory of `z2p run-inference` on a binary PLY of `options.points` points, which is written first."""
    count = int(options.points)
    with tempfile.TemporaryDirectory(prefix="z2p-memory-", dir=options.output) as folder:
        path = Path(folder) / "huge.ply"
        _write_ply(path, count)
        program = "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True)"
        program += "; print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3)"
        command = [sys.executable, "-m", "z2p_renderer.pipeline.cli", "run-inference"]
        command += ["--weights", str(options.weights), "-q"]
        command += [str(path), "-o", str(path.with_suffix(".png"))]
        began = time.perf_counter()
        done = subprocess.run([sys.executable, "-c", program, *command], check=True, capture_output=True, text=True)
        seconds = time.perf_counter() - began
    return {"what": f"a cloud of {count} points, beside its file", "MB": float(done.stdout), "limit": HUGE_CLOUD_LIMIT,
            "seconds": seconds}  # fmt: skip


def _write_ply(path: Path, count: int) -> None:
    rng, base = np.random.default_rng(0), make_cloud(POINTS_PER_WRITE)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    with path.open("wb") as file:
        file.write((header + "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n").encode())
        for first in range(0, count, POINTS_PER_WRITE):
            block = base[: count - first] * rng.uniform(0.98, 1.02)
            file.write(block.astype("<f4").tobytes())


def _resident_megabytes() -> float:
    """Resident memory of this process in MB (Linux)."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES / 1e6


def _draw(path: Path, at: tuple[int, ...], megabytes: tuple[float, ...]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    axes.plot(at, megabytes)
    axes.axhline(LONG_RUN_LIMIT, color="k", linestyle="--", label="limit")
    axes.set(xlabel="pictures", ylabel="memory of the process, MB", ylim=(0, 1.1 * LONG_RUN_LIMIT))
    axes.legend()
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


if __name__ == "__main__":
    main()
