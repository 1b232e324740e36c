"""How fast the render stage is, and where the seconds of a picture go: ``python benchmarks/rendering.py [MESH]``.

Renders a few views of a mesh (by default a shape that z2p makes itself) with Blender several times, each time with one
thing less, and takes the differences. Prints a table and writes ``rendering.json`` to --output. Samples and denoising
are Blender's process; EXR to PNG is ours, which does it while Blender renders the next picture. The seconds of
processors say more on a busy machine.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from subjects import own_mesh

from z2p_renderer.pipeline import render
from z2p_renderer.pipeline.render import RenderSettings, render_scenes
from z2p_renderer.pipeline.rendering.views import sample_view, load_controls

CONTROLS = ("color", "light", "elevation")
SMALL = (32, 32)


def main() -> None:
    """Measure, print and write everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", nargs="?", type=Path)
    parser.add_argument("--views", type=int, default=5, help="of each variant")
    parser.add_argument("--resolution", type=int, default=512)
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--denoise", default="fast", choices=render.DENOISE[1:])
    parser.add_argument("--passes", default="depth,normal")
    parser.add_argument("--output", type=Path, default=Path("previews/benchmarks"))
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    passes = tuple(filter(None, options.passes.split(",")))
    whole = RenderSettings((options.resolution,) * 2, options.samples, options.denoise, passes=passes)
    with tempfile.TemporaryDirectory(prefix="z2p-rendering-") as folder:
        mesh = options.mesh or own_mesh(Path(folder))
        rows, load = measured(mesh, whole, options.views, Path(folder)), os.getloadavg()[0]
    told = f"{options.resolution} x {options.resolution}, {options.samples} samples, {options.denoise}, load {load:.1f}"
    print(f"{told}, {os.cpu_count()} cores\n\n| what | seconds | of processors |\n|---|--:|--:|")
    for name, (seconds, processors) in rows.items():
        print(f"| {name} | {seconds:.2f} | {processors:.2f} |")
    rate = 60 / rows["a picture"][0]
    print(f"\n{rate:.1f} images a minute")
    content = {"settings": told, "seconds, processors' seconds": rows, "images a minute": rate}
    (options.output / "rendering.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def measured(mesh: Path, whole: RenderSettings, views: int, folder: Path) -> dict[str, tuple[float, float]]:
    """Seconds of a picture, and the processors' seconds, in all and in parts."""
    noisy = replace(whole, denoise="off")
    small = replace(noisy, samples=1, resolution=SMALL)
    start, _ = _timed(mesh, small, 1, folder / "start")
    each, develop = {}, {}
    variants = {"whole": whole, "noisy": noisy, "one sample": replace(noisy, samples=1), "small": small}
    for name, settings in variants.items():
        taken, develop[name] = _timed(mesh, settings, views, folder / name)
        each[name] = (taken - start) / (views - 1)
    a_sample = (each["noisy"] - each["one sample"]) / (whole.samples - 1) if whole.samples > 1 else 0 * start
    rows = {
        "a picture": each["whole"],
        "process start, mesh and first scene": start - each["small"],
        "scene sync and all that a tiny picture takes": each["small"],
        "samples": a_sample * whole.samples,
        "the rest of a noisy picture (first sample's set-up, EXR)": each["one sample"] - each["small"] - a_sample,
        "denoising, picture and shadow catcher": each["whole"] - each["noisy"],
        "EXR to PNG, beside the next picture": develop["whole"],
    }
    return {name: (float(row[0]), float(row[1])) for name, row in rows.items()}


def _timed(mesh: Path, settings: RenderSettings, views: int, out: Path) -> tuple[np.ndarray, Any]:
    """Seconds and Blender's processor seconds of rendering so many views; the same of developing one, median."""
    controls, rng = load_controls(CONTROLS), np.random.default_rng(0)
    scenes = [(f"{number:03d}", sample_view(controls, rng, upright=0.5).scene) for number in range(views)]
    developing, develop = [], render._write_outputs

    def watched(exr: Path, folder: Path, stem: str) -> None:
        began = time.perf_counter(), time.process_time()
        develop(exr, folder, stem)
        developing.append((time.perf_counter() - began[0], time.process_time() - began[1]))

    render._write_outputs = watched
    began = np.array([time.perf_counter(), _blenders()])
    try:
        render_scenes(mesh, scenes, out, settings)
    finally:
        render._write_outputs = develop
    return np.array([time.perf_counter(), _blenders()]) - began, np.median(developing, axis=0)


def _blenders() -> float:
    """Processor seconds of the processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
