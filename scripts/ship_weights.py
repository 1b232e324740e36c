"""Adds the weights of a finished pipeline run to those that z2p ships: as float16, with their graphs and card.

    python scripts/ship_weights.py runs/regular regular --meshes DIR --truth runs/truth

writes storage/weights/regular.{safetensors,graph,int8.graph,md}. Graph files are ONNX without the numbers that the
weights hold; all sets together must stay within `MAX_SHIPPED_BYTES`. --meshes are those that the run was evaluated on:
the int8 form ships only if it is worse on them by no more than `MAX_INT8_LOSS`, and never without them.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.config import EvaluateConfig, from_dict
from z2p_renderer.pipeline.evaluation.evaluate import evaluate
from z2p_renderer.pipeline.export import export_onnx
from z2p_renderer.pipeline.export.calibration import calibration_inputs
from z2p_renderer.pipeline.export.graph_rewrite import optimize_graph, quantize_int8
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.meshes import find_meshes
from z2p_renderer.storage.models.checkpoints import SHIPPED_FOLDER, load_weights, save_weights
from z2p_renderer.storage.models.onnx_deltas import INT8, graph_path, save_graph
from z2p_renderer.storage.results.fingerprints import file_digest

MAX_SHIPPED_BYTES = 40e6
"""Size of all shipped sets together."""
CALIBRATION_VIEWS = 24
"""Views that calibrate the int8 form."""
ENGINES = ("torch", "onnxruntime", "onnxruntime-int8")
MAX_INT8_LOSS = {"psnr_white": 0.2, "psnr_foreground": 0.2, "ssim": 0.003}
"""Metric -> how much worse than torch's float32 the int8 form may be."""

CARD = """# Weights `{name}`

Controls: {controls}. Network `{kind}`, widths {widths}; trained at {sides} pixels a side. Stored as float16;
`{name}.graph` makes an ONNX file of them for the engines without torch.

- **The last round** was one of `configs/{config}.toml` (`z2p pipeline --config FILE --meshes DIR
  --evaluate-meshes DIR`), training result `{fingerprint}`; sha256 of the shipped file `{digest}`.
- **Data**: {renders} Cycles renders (and their validation share) of {meshes} meshes: gathered from the public
  repositories alecjacobson/common-3d-test-models, libigl/libigl-tutorial-data and odedstein/meshes, where each keeps
  the licence of its source and none is part of z2p; and, of more than 34, relatives of those by scripts/vary_meshes.py
  and things built by scripts/build_objects.py (docs/meshes.md). {samples} samples seen in this round.
- **Begun** {begun}.
- **Measured** on {evaluated} meshes never trained on, {views} views each, {points} points{noise},
  {resolution}x{resolution}, seed {seed}; controls are drawn at random, elevation apart:

| figure | mean | spread over the pictures |
|---|---|---|
{figures}

- **Limits**: one object on a floor; no per-point colours; detail finer than the gaps between points is guessed, and
  thin parts close to each other may melt together.
"""


def main(run: Path, name: str, meshes: Path | None, truth: Path | None, begun: str = "") -> None:
    """Ships `run/weights.safetensors` under `name`, with the metrics of `run/metrics.json`."""
    weights = load_weights(run / "weights.safetensors")
    metrics = json.loads((run / "metrics.json").read_text(encoding="utf-8"))
    shipped = SHIPPED_FOLDER / f"{name}.safetensors"
    weights.card["training"]["start"] = Path(weights.card["training"].get("start", "")).stem
    save_weights(shipped, weights.tensors, weights.card, half=True)
    engines = export_graphs(shipped, metrics["settings"]["config"], meshes, truth)
    fingerprint = (run / "weights.safetensors").resolve().parent.name
    text = describe(name, run.name, weights.card, metrics, fingerprint, file_digest(shipped), begun) + engines
    shipped.with_suffix(".md").write_text(text, encoding="utf-8")
    for file in sorted(SHIPPED_FOLDER.glob(f"{name}.*")):
        print(f"{file} ({file.stat().st_size / 1e6:.2f} MB)")
    total = sum(file.stat().st_size for file in SHIPPED_FOLDER.iterdir())
    print(f"all that is shipped: {total / 1e6:.1f} MB of {MAX_SHIPPED_BYTES / 1e6:.0f} MB")
    if total > MAX_SHIPPED_BYTES:
        sys.exit(
            f"Error: {name} does not fit: expected at most {MAX_SHIPPED_BYTES / 1e6:.0f} MB in all; "
            "leave out another set"
        )


def export_graphs(shipped: Path, config: dict[str, Any], meshes: Path | None, truth: Path | None) -> str:
    """Replaces the graph files of shipped weights; returns a table of metrics by engine."""
    for form in ("", INT8):
        graph_path(shipped, form).unlink(missing_ok=True)
    exported, loaded = export_onnx(shipped), load_plugins(shipped)
    onnx, digest = exported.read_bytes(), loaded.weights.digest
    exported.unlink()  # an ONNX file would take precedence over the graphs
    plain = optimize_graph(onnx, loaded.buffer_channels, loaded.config.unshuffle)
    save_graph(shipped, digest, plain)
    if meshes is None:
        print("without --meshes: nothing in 8 bits")
        return ""
    calibration = calibration_inputs(Renderer(shipped), CALIBRATION_VIEWS, np.random.default_rng(0))
    save_graph(shipped, digest, quantize_int8(plain, calibration), INT8)
    settings = from_dict(EvaluateConfig, config)
    means = {engine: measure(shipped, settings, meshes, truth, engine) for engine in ENGINES}
    reference, int8 = means["torch"], means["onnxruntime-int8"]
    worse = {figure: reference[figure] - int8[figure] for figure in MAX_INT8_LOSS}
    if any(worse[figure] > MAX_INT8_LOSS[figure] for figure in MAX_INT8_LOSS):
        print(f"8 bits are not good enough and do not ship: expected at most {MAX_INT8_LOSS} worse, got {worse}")
        graph_path(shipped, INT8).unlink()
        del means["onnxruntime-int8"]
    return "\n" + engine_table(means)


def measure(weights: Path, config: EvaluateConfig, meshes: Path, truth: Path | None, engine: str) -> dict[str, float]:
    """Mean metrics of an evaluation on one engine."""
    with tempfile.TemporaryDirectory(prefix="z2p-ship-") as folder:
        out = Path(folder)
        written = evaluate(find_meshes(meshes), weights, out, config, truth or out / "truth", engine=engine)
        means: dict[str, float] = json.loads(written.read_text(encoding="utf-8"))["means"]
    return means


def engine_table(means: dict[str, dict[str, float]]) -> str:
    """Table of the engines' metrics, in Markdown."""
    figures = [figure for figure in next(iter(means.values())) if figure != "seconds"]
    lines = ["- **By engine**, on the same meshes; float16 weights:", ""]
    lines += [f"| engine | {' | '.join(figures)} |", "|---" * (len(figures) + 1) + "|"]
    for engine, own in means.items():
        lines.append(f"| {engine} | {' | '.join(f'{own[figure]:.4f}' for figure in figures)} |")
    return "\n".join([*lines, ""])


def describe(
    name: str,
    run: str,
    card: dict[str, Any],
    metrics: dict[str, Any],
    fingerprint: str,
    digest: str,
    begun: str = "",
) -> str:
    """The model card in Markdown; `begun` says what training started from, where its config cannot."""
    training, config = card["training"], metrics["settings"]["config"]
    sides = card["resolution"]
    share = [(min(sides) / side) ** 2 for side in sides]  # a step at a larger side takes fewer samples
    seen = round(training["steps"] * training["batch"] * sum(share) / len(share))
    figures = [
        f"| {figure} | {mean:.4f} | {metrics['spread'][figure]:.4f} |"
        for figure, mean in metrics["means"].items()
        if figure != "seconds"
    ]
    return CARD.format(
        name=name,
        config=run,
        begun=begun or (f"from `{training['start']}`" if training.get("start") else "at random"),
        controls=", ".join(control["name"] for control in card["controls"]),
        kind=card["network"]["kind"],
        widths="-".join(map(str, card["network"]["widths"])),
        sides=" and ".join(map(str, sorted(set(sides)))),
        fingerprint=fingerprint,
        digest=digest,
        renders=training["renders"],
        meshes=training["meshes"],
        samples=f"{seen:,}",
        evaluated=len(metrics["meshes"]),
        views=config["views"],
        points=f"{config['points']:,}",
        resolution=config["resolution"],
        noise=f" with Gaussian noise of {config['noise']:g} of the radius" if config["noise"] else "",
        seed=config["seed"],
        figures="\n".join(figures),
    )


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder with weights.safetensors and metrics.json")
    parser.add_argument("name", nargs="?", help="of the shipped weights; default: the folder's")
    parser.add_argument("--meshes", type=Path, help="folder of the meshes that the run was evaluated on")
    parser.add_argument("--begun", default="", help="what training started from, for the card")
    parser.add_argument("--truth", type=Path, help="folder that keeps their renders")
    return parser.parse_args()


if __name__ == "__main__":
    options = _options()
    main(options.run, options.name or options.run.name, options.meshes, options.truth, options.begun)
