"""Times a picture, stage by stage and end to end: ``python benchmarks/picture.py``.

Prints a table (median, quartiles, limit, ratio to the baseline of the same run), and writes ``picture.json`` and plots
of time against points and against resolution to --output. Use a quiet machine: the load is printed too, and ``--busy``
measures processor time instead. ``--quick`` takes a minute; ``--points 1e8`` plots the full range.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from inputs import make_cloud, random_weights
from plot_times import plot_times
from timing import Timing, clocks, markdown_table, time_call

from z2p_core import registry
from z2p_core.camera import Camera
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import place_scan
from z2p_renderer.storage.images.image_files import encode_picture
from z2p_renderer.storage.models.checkpoints import WeightsError, find_weights
from z2p_renderer.storage.scans.clouds import read_clouds

CLOUD_POINTS = 5_000
"""Points of the usual cloud."""
ZBUFFER_LIMITS = {5_000: 2.0, 1_000_000: 6.0, 10_000_000: 40.0}
"""Points -> milliseconds."""
PICTURE_LIMITS = {256: 10.0, 512: 30.0}
"""Side in pixels -> milliseconds."""
PROCESS_LIMIT = 700.0
"""Milliseconds from process start to one PNG."""
FOLDER_LIMIT = 8000.0
"""Milliseconds of a process that draws a folder of `FOLDER_CLOUDS`."""
MEMORY_LIMIT = 600.0
"""Peak memory of that process, MB."""
FOLDER_CLOUDS = 200
DOUBLE_LOOP = "z-buffer, 5k points, double loop"
PAPER_NETWORK = "the paper's U-Net, torch, 512"
PAPER_TOTAL = "double loop and the paper's U-Net"


def main() -> None:
    """Measure, print and write everything."""
    options = _options()
    options.output.mkdir(parents=True, exist_ok=True)
    import torch

    torch.set_num_threads(options.threads)
    with tempfile.TemporaryDirectory(prefix="z2p-benchmark-") as folder:
        weights = random_weights(Path(folder)) if options.weights == "random" else Path(options.weights)
        load = os.getloadavg()[0]
        timings = [*_zbuffers(options, weights), *_networks(options, weights), *_cuda(weights)]
        timings += [*_paper_total(timings), *_end_to_end(options, weights, Path(folder))]
        curves, memory = _plot_curves(options, weights), _peak_memory(options, weights, Path(folder))
    machine = _machine(options, load, memory)
    clock = "processor time" if options.busy else "time"
    print(f"{machine['processor']}, {clock} on {options.threads} of {machine['cores']} cores, load {load:.1f} before\n")
    print(markdown_table(timings))
    if memory is not None:
        print(
            f"\npeak memory of z2p over a folder of {FOLDER_CLOUDS} clouds: {memory:.0f} MB, limit {MEMORY_LIMIT:.0f}"
        )
    content = {"machine": machine, "figures": [one.to_json() for one in timings], "curves": curves}
    (options.output / "picture.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    print(f"\nwrote {options.output / 'picture.json'} and the curves beside it")


def _options() -> Any:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", default="regular", help="name, file, or random: random numbers of regular's shape")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--points", type=float, default=1e6, help="largest cloud of the curve (1e8: 1.2 GB)")
    parser.add_argument("--quick", action="store_true", help="no process starts, no paper's network, short curves")
    parser.add_argument("--busy", action="store_true", help="one thread, and its processor time: for a busy machine")
    parser.add_argument("--output", type=Path, default=Path("previews/benchmarks"))
    options = parser.parse_args()
    if options.busy:
        options.threads = 1
        clocks.append(time.process_time)
    return options


def _zbuffers(options: Any, weights: Path) -> list[Timing]:
    from reference_implementations import double_loop, torch_scatter

    camera, (zbuffer, gbuffer) = Camera(512, 512), _buffers(weights)
    figures = [time_call(DOUBLE_LOOP, partial(double_loop, make_cloud(CLOUD_POINTS), camera), warm=False, repeats=3)]
    for count, limit in ZBUFFER_LIMITS.items():
        if count > options.points:
            continue
        cloud, points = make_cloud(count), _count_name(count)
        scatter = f"z-buffer, {points} points, torch scatter"
        figures.append(time_call(scatter, partial(torch_scatter, cloud, camera)))
        floor = time_call("read", partial(np.max, cloud.view(np.uint32).reshape(-1))).median
        figures.append(time_call(f"z-buffer, {points} points", partial(zbuffer.draw, cloud, camera), limit,
                               DOUBLE_LOOP if count == CLOUD_POINTS else scatter, floor))  # fmt: skip
    scene = SceneDescription()
    figures += [
        time_call(f"G-buffer, {_count_name(count)} points", partial(gbuffer.draw, make_cloud(count), camera, scene))
        for count in (CLOUD_POINTS, 100_000)
    ]
    return figures


def _buffers(weights: Path) -> tuple[Any, Any]:
    """The z-buffer and the G-buffer of the weights."""
    loaded = load_plugins(find_weights(weights))
    return loaded.zbuffer, loaded.gbuffer


def _networks(options: Any, weights: Path) -> list[Timing]:
    figures = []
    if not options.quick:
        from reference_implementations import paper_network

        figures.append(time_call(PAPER_NETWORK, paper_network(512), repeats=3, warm=False))
    for side in (256, 512):
        for name in reversed(_engines(weights, options.threads)):  # torch first, as it is the baseline of the others
            renderer = Renderer(weights, options.threads, name)
            run = partial(renderer._engine.draw, *renderer.inputs(make_cloud(CLOUD_POINTS), None, side, side))
            figures.append(time_call(f"network, {name}, {side}", run, baseline=f"network, torch, {side}"))
    return figures


def _cuda(weights: Path) -> list[Timing]:
    """Times on the graphics card, without transfers, and the lower bound by its memory bandwidth."""
    import torch

    if not torch.cuda.is_available():
        return []
    from reference_implementations import cuda_network

    figures = []
    for side in (256, 512):
        for batch in (1, 16):
            run, floor = cuda_network(weights, side, batch)
            figures.append(time_call(f"network, torch on CUDA, {side}, batch {batch}", run, floor=floor))
    return figures


def _engines(weights: Path, threads: int) -> list[str]:
    """The engines that can run these weights here."""
    engines = []
    for name in registry.names("engines"):
        try:
            Renderer(weights, threads, name)
        except (WeightsError, registry.PluginError):
            continue
        engines.append(name)
    return engines


def _paper_total(timings: list[Timing]) -> list[Timing]:
    """The paper's method in total: the sum of the times of its parts."""
    parts = [one for one in timings if one.what in (DOUBLE_LOOP, PAPER_NETWORK)]
    if len(parts) < 2:
        return []
    sums = (sum(getattr(one, name) for one in parts) for name in ("median", "low", "high"))
    return [Timing(PAPER_TOTAL, *sums, min(one.repeats for one in parts))]


def _end_to_end(options: Any, weights: Path, folder: Path) -> list[Timing]:
    cloud, scan = make_cloud(CLOUD_POINTS), folder / "scans" / "scan_000.xyz"
    scan.parent.mkdir()
    for number in range(FOLDER_CLOUDS if not (options.quick or options.busy) else 1):
        np.savetxt(scan.with_name(f"scan_{number:03d}.xyz"), cloud, fmt="%.6f")
    np.save(folder / "scan.npy", cloud)
    figures = [
        time_call("read, 5k points, .xyz", partial(read_clouds, scan)),
        time_call("read, 5k points, .npy", partial(read_clouds, folder / "scan.npy")),
        time_call("place, 5k points", partial(place_scan, read_clouds(scan)[0], ".xyz", PlacementOptions())),
    ]
    engines = _engines(weights, options.threads)
    for side, limit in PICTURE_LIMITS.items():
        for name in engines:
            run = partial(Renderer(weights, options.threads, name).render, cloud, None, side, side)
            baseline = PAPER_TOTAL if side == 512 else None
            figures.append(time_call(f"points to RGBA, {side}, {name}", run, limit, baseline))
    picture = Renderer(weights, options.threads).render(cloud)
    figures.append(time_call("encode, 512, .png", partial(encode_picture, picture, ".png")))
    if options.quick or options.busy:  # the processor time of other processes is not ours
        return figures
    command = _command(weights)
    alone = [*command, str(scan), "-o", str(folder / "one.png")]
    figures.append(
        time_call("process start to PNG, 5k points, 512", partial(_process, alone), PROCESS_LIMIT, repeats=5)
    )
    for name in engines:
        many = [*command, str(scan.parent), "-o", str(folder / "many"), "--engine", name]
        what = f"process, a folder of {FOLDER_CLOUDS} clouds of 5k points, {name}"
        figures.append(time_call(what, partial(_process, many), FOLDER_LIMIT, repeats=3, warm=False))
    return figures


def _process(command: list[str]) -> None:
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _plot_curves(options: Any, weights: Path) -> dict[str, Any]:
    """Milliseconds against points and against the image's side, also plotted."""
    camera, scene, (zbuffer, gbuffer) = Camera(512, 512), SceneDescription(), _buffers(weights)
    counts = [10**power for power in range(3, 9) if 10**power <= options.points]
    points: dict[str, list[float]] = {"z-buffer": [], "G-buffer": [], "reading 12 bytes a point": []}
    for count in counts:
        cloud = make_cloud(count)
        runs = (partial(zbuffer.draw, cloud, camera), partial(gbuffer.draw, cloud, camera, scene),
                partial(np.max, cloud.view(np.uint32).reshape(-1)))  # fmt: skip
        for name, run in zip(points, runs, strict=True):
            points[name].append(time_call(name, run, repeats=5).median)
    sides = (128, 256, 512) if options.quick else (128, 256, 512, 1024, 2048)
    renderer, cloud = Renderer(weights, options.threads), make_cloud(CLOUD_POINTS)
    pixels = [
        time_call("picture", partial(renderer.render, cloud, None, side, side), repeats=5).median for side in sides
    ]
    resolution = {f"points to RGBA, {renderer.engine}": pixels}
    plot_times(options.output / "points.png", "points", counts, points, ZBUFFER_LIMITS)
    plot_times(options.output / "resolution.png", "side in pixels", sides, resolution, PICTURE_LIMITS)
    return {"points": {"at": counts, **points}, "resolution": {"at": list(sides), **resolution}}


def _peak_memory(options: Any, weights: Path, folder: Path) -> float | None:
    """Peak memory in MB of a process that draws a folder, measured by a small parent, as a child inherits our peak."""
    if options.quick or options.busy:
        return None
    program = "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True)"
    program += "; print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3)"
    command = [*_command(weights), str(folder / "scans"), "-o", str(folder / "many")]
    return float(subprocess.run([sys.executable, "-c", program, *command], check=True, capture_output=True).stdout)


def _command(weights: Path) -> list[str]:
    command = [sys.executable, "-m", "z2p_renderer.pipeline.cli", "run-inference"]
    return [*command, "--weights", str(weights), "-q", "--overwrite"]


def _machine(options: Any, load: float, memory: float | None) -> dict[str, Any]:
    models = [line.split(":", 1)[1].strip() for line in _cpuinfo().splitlines() if line.startswith("model name")]
    versions = {name: __import__(name).__version__ for name in ("numpy", "torch", "onnxruntime", "openvino")
                if name not in registry.names("engines") or registry.load("engines", name).installed()}  # fmt: skip
    return {
        "processor": models[0] if models else platform.machine(), "cores": os.cpu_count(), "threads": options.threads,
        "load before": load, "busy": options.busy, "versions": versions, "weights": str(options.weights),
        "peak memory of the benchmark, MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "peak memory of z2p over a folder, MB": memory, "limit of that, MB": MEMORY_LIMIT,
    }  # fmt: skip


def _cpuinfo() -> str:
    path = Path("/proc/cpuinfo")
    return path.read_text() if path.exists() else ""


def _count_name(count: int) -> str:
    return f"{count // 1_000_000}M" if count >= 1_000_000 else f"{count // 1000}k"


if __name__ == "__main__":
    main()
