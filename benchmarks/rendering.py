"""Times the render stage and the parts of a picture: ``python benchmarks/rendering.py [MESH]``.

Renders a few views of a mesh (by default a built-in shape) several times, each time with one step less, and takes the
differences. Prints a table and writes ``rendering.json`` to --output. Sampling and denoising run in Blender's process;
EXR to PNG runs in ours, while Blender renders the next picture. On a busy machine compare processor seconds.
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
from inputs import write_example_mesh

from z2p_renderer.pipeline import render
from z2p_renderer.pipeline.render import RenderSettings, render_scenes
from z2p_renderer.pipeline.rendering.views import load_controls, sample_view

CONTROLS = ("color", "light", "elevation")
TINY = (32, 32)
"""Resolution of a picture that costs almost nothing but its fixed overhead."""


def main() -> None:
    """Measure, print and write everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", nargs="?", type=Path)
    parser.add_argument("--views", type=int, default=5, help="of each variant")
    parser.add_argument("--resolution", type=int, default=512)
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--denoise", default="fast", choices=render.DENOISE_QUALITIES[1:])
    parser.add_argument("--passes", default="depth,normal")
    parser.add_argument("--output", type=Path, default=Path("previews/benchmarks"))
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    passes = tuple(filter(None, options.passes.split(",")))
    full = RenderSettings((options.resolution,) * 2, options.samples, options.denoise, passes=passes)
    with tempfile.TemporaryDirectory(prefix="z2p-rendering-") as folder:
        mesh = options.mesh or write_example_mesh(Path(folder))
        rows, load = measured(mesh, full, options.views, Path(folder)), os.getloadavg()[0]
    described = (
        f"{options.resolution} x {options.resolution}, {options.samples} samples, {options.denoise}, load {load:.1f}"
    )
    print(f"{described}, {os.cpu_count()} cores\n\n| what | seconds | of processors |\n|---|--:|--:|")
    for name, (seconds, processors) in rows.items():
        print(f"| {name} | {seconds:.2f} | {processors:.2f} |")
    rate = 60 / rows["a picture"][0]
    print(f"\n{rate:.1f} images a minute")
    content = {"settings": described, "seconds, processors' seconds": rows, "images a minute": rate}
    (options.output / "rendering.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def measured(mesh: Path, full: RenderSettings, views: int, folder: Path) -> dict[str, tuple[float, float]]:
    """Seconds and processor seconds of a picture, in total and by part."""
    noisy = replace(full, denoise="off")
    small = replace(noisy, samples=1, resolution=TINY)
    start, _ = _timed(mesh, small, 1, folder / "start")
    each, conversion = {}, {}
    variants = {"whole": full, "noisy": noisy, "one sample": replace(noisy, samples=1), "small": small}
    for name, settings in variants.items():
        taken, conversion[name] = _timed(mesh, settings, views, folder / name)
        each[name] = (taken - start) / (views - 1)
    a_sample = (each["noisy"] - each["one sample"]) / (full.samples - 1) if full.samples > 1 else 0 * start
    rows = {
        "a picture": each["whole"],
        "process start, mesh and first scene": start - each["small"],
        "scene sync and all that a tiny picture takes": each["small"],
        "samples": a_sample * full.samples,
        "the rest of a noisy picture (first sample's set-up, EXR)": each["one sample"] - each["small"] - a_sample,
        "denoising, picture and shadow catcher": each["whole"] - each["noisy"],
        "EXR to PNG, beside the next picture": conversion["whole"],
    }
    return {name: (float(row[0]), float(row[1])) for name, row in rows.items()}


def _timed(mesh: Path, settings: RenderSettings, views: int, out: Path) -> tuple[np.ndarray, Any]:
    """Seconds and Blender's processor seconds of rendering `views` views; the median of both for converting one EXR."""
    controls, rng = load_controls(CONTROLS), np.random.default_rng(0)
    scenes = [(f"{number:03d}", sample_view(controls, rng, upright=0.5).scene) for number in range(views)]
    conversions, convert = [], render._write_outputs

    def timed_convert(exr: Path, folder: Path, stem: str) -> None:
        began = time.perf_counter(), time.process_time()
        convert(exr, folder, stem)
        conversions.append((time.perf_counter() - began[0], time.process_time() - began[1]))

    render._write_outputs = timed_convert
    began = np.array([time.perf_counter(), _child_processor_seconds()])
    try:
        render_scenes(mesh, scenes, out, settings)
    finally:
        render._write_outputs = convert
    return np.array([time.perf_counter(), _child_processor_seconds()]) - began, np.median(conversions, axis=0)


def _child_processor_seconds() -> float:
    """Processor seconds of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
