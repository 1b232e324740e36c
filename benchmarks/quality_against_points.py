"""Quality against the number of points: ``python benchmarks/quality_against_points.py --output DIR [--truth DIR]``.

Evaluates weights and baselines as `z2p evaluate` does, on each mesh with each number of points, and writes
``quality.json`` (the means of each method, for each number) and ``quality.svg``. What is done is kept in DIR: a run
that was stopped goes on where it was, and one with more meshes or numbers adds them. Give a new DIR for other code; the
truth and the baselines' pictures, which do not depend on it, are taken from --truth. A baseline that was stopped is not
tried on larger clouds of that mesh.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from z2p_core.config import EvaluateConfig, to_dict
from z2p_renderer.pipeline.detailed_meshes.objects import DETAILED, make_detailed_meshes
from z2p_renderer.pipeline.evaluation.evaluate import evaluate
from z2p_renderer.storage.meshes import find_meshes

COUNTS = "1000,3162,10000,31623,100000,316228,1000000"
PLOTTED = {
    "psnr_foreground": "PSNR of the object, dB",
    "ssim": "SSIM",
    "flip": "FLIP (less is better)",
    "shadow_l1": "error of the shadow (less is better)",
}
"""Metric -> title of its plot."""
OURS = "z2p"

Results = dict[int, dict[str, Any]]
"""Number of points -> contents of ``metrics.json`` of each mesh, by name."""


@click.command()
@click.option("--meshes", default=DETAILED, help="A folder, or `detailed`.")
@click.option("--only", default="", help="Comma-separated names of meshes; all by default.")
@click.option("--points", default=COUNTS, help="Comma-separated numbers of points.")
@click.option("--resolution", default=512, type=int)
@click.option("--views", default=1, type=int)
@click.option("--samples", default=32, type=int)
@click.option("--baseline", default="bpa,splats,screen", help="Comma-separated baselines; empty for none.")
@click.option("--baseline-seconds", default=120.0, type=float)
@click.option("--weights", default="regular")
@click.option("--engine", default="onnxruntime")
@click.option("--truth", type=click.Path(path_type=Path), help="Folder of the truth.  [default: DIR/truth]")
@click.option("--output", required=True, type=click.Path(path_type=Path), metavar="DIR")
def main(
    meshes: str, only: str, points: str, baseline: str, baseline_seconds: float, weights: str, engine: str,
    truth: Path | None, output: Path, **config: Any,
) -> None:  # fmt: skip
    """Curves of quality against points, for z2p and baselines."""
    truth = truth or output / "truth"
    wanted = _names(only)
    files = make_detailed_meshes(truth / "meshes", wanted) if meshes == DETAILED else find_meshes(Path(meshes))
    files = {name: path for name, path in files.items() if name in wanted or not wanted}
    results: Results = {}
    stopped: set[tuple[str, str]] = set()
    for count in sorted(int(float(number)) for number in _names(points)):
        settings = EvaluateConfig(points=count, **config)
        for name, path in files.items():
            competitors = tuple(one for one in _names(baseline) if (name, one) not in stopped)
            folder = output / f"{name}-{count}-{settings.resolution}"
            if not _is_done(folder / "metrics.json", settings, competitors):
                evaluate({name: path}, weights, folder, settings, truth, click.echo, competitors, engine,
                         baseline_seconds)  # fmt: skip
            metrics = json.loads((folder / "metrics.json").read_text())
            stopped |= {(name, one) for one, own in metrics["baselines"].items() if "stopped" in own}
            results.setdefault(count, {})[name] = metrics
        curves = summarise(results)
        (output / "quality.json").write_text(json.dumps({"config": to_dict(settings), "methods": curves}, indent=1))
        plot(curves, output / "quality.svg")
    _print(curves)


def summarise(results: Results) -> dict[str, dict[int, dict[str, float]]]:
    """Method -> number of points -> the means over the meshes that it did, and their number as ``meshes``."""
    curves: dict[str, dict[int, dict[str, float]]] = {}
    for count, by_mesh in results.items():
        for metrics in by_mesh.values():
            for method in (OURS, *metrics["baselines"]):
                curves.setdefault(method, {})
        for method, curve in curves.items():
            own = [metrics if method == OURS else metrics["baselines"].get(method, {}) for metrics in by_mesh.values()]
            means = [one["means"] for one in own if one.get("means")]
            names = {name for one in means for name in one}
            curve[count] = {name: float(np.mean([one[name] for one in means if name in one])) for name in sorted(names)}
            curve[count]["meshes"] = len(means)
    return curves


def plot(curves: Mapping[str, Mapping[int, Mapping[str, float]]], path: Path) -> None:
    """A plot for each metric; a baseline's line ends where it did not do all meshes."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    pyplot.rcParams["svg.hashsalt"] = "z2p"
    figure, all_axes = pyplot.subplots(2, 2, figsize=(9, 6), layout="constrained", sharex=True)
    for axes, (metric, title) in zip(all_axes.flat, PLOTTED.items(), strict=True):
        for method, curve in curves.items():
            complete = {
                count: means for count, means in curve.items() if means["meshes"] == curves[OURS][count]["meshes"]
            }
            axes.plot(list(complete), [means[metric] for means in complete.values()], marker=".", label=method)
        axes.set(title=title, xscale="log")
        axes.grid(alpha=0.3)
    for axes in all_axes[-1]:
        axes.set_xlabel("points")
    all_axes.flat[0].legend()
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _is_done(path: Path, config: EvaluateConfig, baselines: Sequence[str]) -> bool:
    if not path.exists():
        return False
    stored = json.loads(path.read_text())
    same = stored["settings"]["config"] == json.loads(json.dumps(to_dict(config)))
    return same and set(baselines) <= set(stored["baselines"])


def _print(curves: Mapping[str, Mapping[int, Mapping[str, float]]]) -> None:
    click.echo(f"{'method':<10}{'points':>9}{'meshes':>8}" + "".join(f"{metric:>17}" for metric in PLOTTED))
    for method, curve in curves.items():
        for count, means in curve.items():
            cells = (f"{means[metric]:17.4f}" if metric in means else f"{'-':>17}" for metric in PLOTTED)
            click.echo(f"{method:<10}{count:>9}{means['meshes']:>8.0f}" + "".join(cells))


if __name__ == "__main__":
    main()
