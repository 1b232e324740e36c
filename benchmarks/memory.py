"""What memory a long run and a huge cloud take: ``python benchmarks/endurance.py``.

Draws ``--pictures`` small pictures in one process and watches its memory, and a cloud of ``--points`` through `z2p
run-inference`. Prints a table, and writes ``endurance.json`` and the curve ``memory.png`` to --output.
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
from subjects import cloud_of

from z2p_core.meshes.synthetic_noise import add_noise
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.images.image_files import encode_picture

PAGE = resource.getpagesize()
MEMORY_LIMIT, LARGE_LIMIT, GROWTH_LIMIT = 600.0, 1000.0, 5.0
"""MB of a long run, of a process beside the file of a huge cloud, and from one half of a long run to the other."""
SIDES, POINTS = (64, 96), (200, 2000)
"""Of the small pictures and their clouds, so that no two follow each other alike."""
READINGS = 200
BLOCK = 2_000_000
"""Points of the huge cloud that are written at a time."""


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
    (options.output / "endurance.json").write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    print(f"\nwrote {options.output / 'endurance.json'} and memory.png beside it")


def long_run(options: Any) -> list[dict[str, Any]]:
    """Peak and growth of this process's memory over many pictures, each of another cloud, light and colour."""
    renderer, rng = Renderer(options.weights, threads=1), np.random.default_rng(0)
    base, curve, began = cloud_of(POINTS[1]), [], time.perf_counter()
    every = max(1, options.pictures // READINGS)
    for number in range(options.pictures):
        side, count = int(rng.choice(SIDES)), int(rng.integers(*POINTS))
        values = {name: control.draw(rng) for name, control in renderer.controls.items()}
        cloud = add_noise(base[:count], "gaussian", 0.01, rng)
        encode_picture(renderer.render(cloud, values, side, side), ".png", record={"record": 1, "number": number})
        if number % every == 0:
            curve.append((number, _resident()))
    at, megabytes = zip(*curve, strict=True)
    _draw(options.output / "memory.png", at, megabytes)
    settled = np.array(megabytes[len(megabytes) // 10 :])  # the first pictures fill what is kept
    halves = np.array_split(settled, 2)
    growth = float(halves[1].mean() - halves[0].mean())
    what = f"{options.pictures} pictures"
    return [
        {"what": f"{what}: most memory of the process", "MB": max(megabytes), "limit": MEMORY_LIMIT, "curve": curve,
         "seconds": time.perf_counter() - began},
        {"what": f"{what}: growth from the first half to the second", "MB": growth, "limit": GROWTH_LIMIT},
    ]  # fmt: skip


def huge_cloud(options: Any) -> dict[str, Any]:
    """Peak memory of `z2p run-inference` on a binary PLY of that many points, which is written for it."""
    count = int(options.points)
    with tempfile.TemporaryDirectory(prefix="z2p-endurance-", dir=options.output) as folder:
        path = Path(folder) / "huge.ply"
        _write_ply(path, count)
        told = "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True)"
        told += "; print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3)"
        command = [sys.executable, "-m", "z2p_renderer.pipeline.cli", "run-inference"]
        command += ["--weights", str(options.weights), "-q"]
        command += [str(path), "-o", str(path.with_suffix(".png"))]
        began = time.perf_counter()
        done = subprocess.run([sys.executable, "-c", told, *command], check=True, capture_output=True, text=True)
        seconds = time.perf_counter() - began
    return {"what": f"a cloud of {count} points, beside its file", "MB": float(done.stdout), "limit": LARGE_LIMIT,
            "seconds": seconds}  # fmt: skip


def _write_ply(path: Path, count: int) -> None:
    rng, base = np.random.default_rng(0), cloud_of(BLOCK)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    with path.open("wb") as file:
        file.write((header + "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n").encode())
        for first in range(0, count, BLOCK):
            block = base[: count - first] * rng.uniform(0.98, 1.02)
            file.write(block.astype("<f4").tobytes())


def _resident() -> float:
    """This process's memory in MB, as Linux tells it."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 1e6


def _draw(path: Path, at: tuple[int, ...], megabytes: tuple[float, ...]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    axes.plot(at, megabytes)
    axes.axhline(MEMORY_LIMIT, color="k", linestyle="--", label="limit")
    axes.set(xlabel="pictures", ylabel="memory of the process, MB", ylim=(0, 1.1 * MEMORY_LIMIT))
    axes.legend()
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


if __name__ == "__main__":
    main()
