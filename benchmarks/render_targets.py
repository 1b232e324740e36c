"""Measures error and cost of training targets: ``python benchmarks/render_targets.py [MESH]``.

Renders a few views of a mesh (by default a built-in shape) at 512x512 with few samples and several seeds, halves them,
and compares them with clean renders: one picture alone, and the mean over the seeds. The noise of one picture averages
out in training; the error of the mean, a bias of the denoiser, does not.

Prints a table and writes ``render_targets.json`` to --output.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from inputs import write_example_mesh

from z2p_core.images import area_average, shrink
from z2p_core.quality.metrics import image_metrics
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.render import RenderSettings, read_render, render_scenes
from z2p_renderer.pipeline.rendering.views import load_controls, sample_view

SIDE = 512
REFERENCE_SETTINGS = RenderSettings((SIDE, SIDE), 256, "high", seed=1000)
SETTINGS = ((4, "fast"), (4, "high"), (8, "fast"), (16, "fast"), (16, "high"))
METRICS = ("flip", "ssim", "shadow_l1")

Scenes = list[tuple[str, SceneDescription]]


def main() -> None:
    """Measure, print and write everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", nargs="?", type=Path)
    parser.add_argument("--views", type=int, default=2)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--output", type=Path, default=Path("previews/benchmarks"))
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    controls, rng = load_controls(("color", "light", "elevation")), np.random.default_rng(0)
    scenes = [(f"{number:03d}", sample_view(controls, rng, upright=0.5).scene) for number in range(options.views)]
    print("| samples | denoising | seconds | one: FLIP | SSIM | shadow L1 | mean: FLIP | SSIM | shadow L1 |")
    print("|--:|---|--:|--:|--:|--:|--:|--:|--:|")
    rows = []
    with tempfile.TemporaryDirectory(prefix="z2p-targets-") as temporary:
        folder = Path(temporary)
        mesh = options.mesh or write_example_mesh(folder)
        clean, _ = _rendered(mesh, scenes, REFERENCE_SETTINGS, folder / "clean")
        for samples, denoise in SETTINGS:
            settings = replace(REFERENCE_SETTINGS, samples=samples, denoise=denoise)
            row = measured(mesh, scenes, settings, options.seeds, clean, folder / f"{samples}-{denoise}")
            rows.append({"samples": samples, "denoise": denoise, **row})
            figures = " | ".join(f"{row[whose][name]:.4f}" for whose in ("one", "mean") for name in METRICS)
            print(f"| {samples} | {denoise} | {row['seconds']:.1f} | {figures} |", flush=True)
    (options.output / "render_targets.json").write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


def measured(
    mesh: Path, scenes: Scenes, settings: RenderSettings, seeds: int, clean: np.ndarray, folder: Path
) -> dict[str, Any]:
    """Seconds per picture, and the metrics of one picture and of the mean over seeds, averaged over the views."""
    drawn, seconds = zip(*(
        _rendered(mesh, scenes, replace(settings, seed=seed), folder / str(seed)) for seed in range(seeds)
    ), strict=True)  # fmt: skip
    compared = {"one": drawn[0], "mean": np.mean(drawn, axis=0)}
    metrics = {}
    for name, pictures in compared.items():
        rows = [image_metrics(ours[..., :4], truth[..., :4], truth[..., 4])
                 for ours, truth in zip(pictures, clean, strict=True)]  # fmt: skip
        metrics[name] = {metric: float(np.mean([row[metric] for row in rows])) for metric in METRICS}
    return {"seconds": float(np.median(seconds)), **metrics}


def _rendered(mesh: Path, scenes: Scenes, settings: RenderSettings, out: Path) -> tuple[np.ndarray, float]:
    """Pictures (V, H, W, 5) at half the side, RGBA and the object's coverage, and the seconds that each took."""
    began = time.perf_counter()
    render_scenes(mesh, scenes, out, settings)
    seconds = (time.perf_counter() - began) / len(scenes)
    pictures = []
    for stem, _ in scenes:
        picture = shrink(read_render(out / f"{stem}.png", (SIDE, SIDE, 4)), 2)
        coverage = area_average(read_render(out / f"{stem}.coverage.png", (SIDE, SIDE)), 2)
        pictures.append(np.concatenate([picture, coverage[..., None]], axis=-1))
    return np.stack(pictures), seconds


if __name__ == "__main__":
    main()
