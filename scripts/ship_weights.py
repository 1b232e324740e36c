"""Puts the weights of a finished pipeline run among those that z2p ships, as float16, with their export and card.

    python scripts/ship_weights.py runs/regular regular    # -> storage/weights/regular.{safetensors,graph,md}

The ONNX export is shipped as a graph file, which leaves out the numbers that the weights hold: all sets together must
stay within `LARGEST`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from pipeline.export import export_onnx
from storage.checkpoints import SHIPPED, load_weights, save_weights
from storage.fingerprints import file_digest
from storage.graphs import save_graph

LARGEST = 40e6
"""Bytes of all shipped sets together."""

CARD = """# Weights `{name}`

Controls: {controls}. Network `{kind}`, widths {widths}; trained at {sides} pixels a side. Stored as float16;
`{name}.graph` makes an ONNX file of them for the engines without torch.

- **Made by** `z2p pipeline --config configs/{config}.toml --meshes DIR --evaluate-meshes DIR`, training result
  `{fingerprint}`; sha256 of the shipped file `{digest}`.
- **Data**: {renders} Cycles renders (and their validation share) of {meshes} meshes gathered from the public
  repositories alecjacobson/common-3d-test-models, libigl/libigl-tutorial-data and odedstein/meshes; each mesh keeps the
  licence of its source, and none is part of z2p. {samples} samples seen,
  {begun}.
- **Measured** on {evaluated} meshes never trained on, {views} views each, {points} points, {resolution}x{resolution}:

| figure | mean | spread over the pictures |
|---|---|---|
{figures}

- **Limits**: one object on a floor; no per-point colours; detail finer than the gaps between points is guessed, and
  thin parts close to each other may melt together.
"""


def main(run: Path, name: str) -> None:
    """Ship `run/weights.safetensors` under `name`; its figures come from `run/metrics.json`."""
    weights = load_weights(run / "weights.safetensors")
    metrics = json.loads((run / "metrics.json").read_text(encoding="utf-8"))
    shipped = SHIPPED / f"{name}.safetensors"
    save_weights(shipped, weights.tensors, weights.card, half=True)
    exported = export_graph(shipped)
    fingerprint = (run / "weights.safetensors").resolve().parent.name
    text = describe(name, run.name, weights.card, metrics, fingerprint, file_digest(shipped))
    shipped.with_suffix(".md").write_text(text, encoding="utf-8")
    for file in (shipped, exported):
        print(f"{file} ({file.stat().st_size / 1e6:.1f} MB)")
    print(shipped.with_suffix(".md"))
    total = sum(file.stat().st_size for file in SHIPPED.iterdir())
    print(f"all that is shipped: {total / 1e6:.1f} MB of {LARGEST / 1e6:.0f} MB")
    if total > LARGEST:
        sys.exit(f"Error: {name} does not fit: expected at most {LARGEST / 1e6:.0f} MB in all; leave out another set")


def export_graph(shipped: Path) -> Path:
    """The graph file of shipped weights, in place of any whole export beside them."""
    exported = export_onnx(shipped)
    graph = save_graph(shipped, load_weights(shipped).digest, exported.read_bytes())
    exported.unlink()
    return graph


def describe(
    name: str, run: str, card: dict[str, Any], metrics: dict[str, Any], fingerprint: str, digest: str
) -> str:
    """The model card in Markdown."""
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
        begun=f"fine-tuned from `{training['start']}`" if training.get("start") else "begun at random",
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
        figures="\n".join(figures),
    )


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    main(folder, sys.argv[2] if len(sys.argv) == 3 else folder.name)
