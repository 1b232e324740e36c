"""Measures the gain of more samples, renders or channels: trains at several of each, and fits curves.

    python scripts/measure_growth.py --meshes DIR --evaluate-meshes DIR [--config configs/growth.toml] [--output DIR]

Needs the pipeline extra. Each point is a `z2p pipeline` run, so finished ones are not run again. Prints a table, fits
FLIP = floor + scale * x^-rate, and extrapolates to `--target`; writes growth.md and growth.json.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from z2p_core.config import PipelineConfig, parse_config, to_dict

ROOT = Path(__file__).parents[1]
FACTORS: dict[str, tuple[float, ...]] = {
    "samples": (1 / 4, 1 / 2, 1, 2), "renders": (1 / 8, 1 / 4, 1 / 2, 1), "channels": (1 / 2, 3 / 4, 1, 3 / 2),
}  # fmt: skip
"""Axis -> factors of the config's amount. With even fewer samples a training has hardly started."""
FIT_RATES = np.linspace(0.05, 2, 196)
"""Exponents tried in a fit."""
MIN_FIT_POINTS = 4
"""Fewest points for a fit of three parameters."""
METRICS = ("flip", "psnr_foreground", "ssim", "alpha_l1")


class Fit(NamedTuple):
    """A curve `floor + scale * x**-rate`, and the root mean square of its relative errors."""

    floor: float
    scale: float
    rate: float
    error: float

    def reaches(self, target: float) -> float | None:
        """The x at which the curve reaches the target; None if it never does."""
        if target <= self.floor or self.scale <= 0:
            return None
        return float((self.scale / (target - self.floor)) ** (1 / self.rate))


def main() -> None:
    """Runs what is missing, fits, prints and writes."""
    options = _options()
    base = parse_config(options.config.read_text(encoding="utf-8"), str(options.config))
    options.output.mkdir(parents=True, exist_ok=True)
    measured = {
        axis: [{"times": times, **_means(varied(base, axis, times), options)} for times in FACTORS[axis]]
        for axis in options.axes
    }
    text = growth_report(measured, options.target)
    print(text)
    (options.output / "growth.md").write_text(text, encoding="utf-8")
    (options.output / "growth.json").write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")


def varied(base: PipelineConfig, axis: str, times: float) -> PipelineConfig:
    """The config with `times` the samples, renders or channels; for 1 it is the base, shared by all axes."""
    train = base.train
    if axis == "samples":
        train = replace(train, steps=round(train.steps * times))
    elif axis == "renders":
        train = replace(train, validation_share=1 - (1 - train.validation_share) * times)
    else:
        widths = tuple(8 * max(round(width * times / 8), 1) for width in train.network.widths)
        train = replace(train, network=replace(train.network, widths=widths))
    name = base.name if times == 1 else f"{base.name}-{axis}-{times:g}"
    return replace(base, name=name, train=base.train if times == 1 else train)


def to_toml(table: Mapping[str, Any], path: str = "") -> str:
    """A nested dict as TOML; values of None are left out."""
    values = [f"{key} = {json.dumps(value)}" for key, value in table.items()
              if value is not None and not isinstance(value, dict)]  # fmt: skip
    deeper = [(f"{path}.{key}".lstrip("."), value) for key, value in table.items() if isinstance(value, dict)]
    return "\n".join([*values, *(f"\n[{name}]\n{to_toml(value, name)}" for name, value in deeper)])


def fit_curve(points: Sequence[tuple[float, float]]) -> Fit | None:
    """The best curve through points (x, y) with a floor of 0 or more; None for fewer than `MIN_FIT_POINTS`."""
    if len(points) < MIN_FIT_POINTS:
        return None
    x, y = np.array(points, dtype=float).T
    fits = []
    for rate in FIT_RATES:
        power = x**-rate
        scale, floor = np.polyfit(power, y, 1, w=1 / y)
        if floor < 0:
            floor, scale = 0.0, float((power / y).sum() / ((power / y) ** 2).sum())
        error = float(np.sqrt(np.mean(((floor + scale * power) / y - 1) ** 2)))
        fits.append(Fit(float(floor), float(scale), float(rate), error))
    return min(fits, key=lambda fit: fit.error)


def growth_report(measured: Mapping[str, Sequence[Mapping[str, float]]], target: float) -> str:
    """The metrics and fits in Markdown."""
    lines = []
    for axis, points in measured.items():
        lines += [f"| {axis} | FLIP | object, dB | SSIM | alpha L1 |", "|--:" * 5 + "|"]
        lines += [
            f"| x {point['times']:g} | {point['flip']:.4f} | {point['psnr_foreground']:.2f} | {point['ssim']:.4f} | "
            f"{point['alpha_l1']:.5f} |" for point in points
        ]  # fmt: skip
        lines += ["", _conclusion(axis, fit_curve([(point["times"], point["flip"]) for point in points]), target), ""]
    return "\n".join(lines)


def _conclusion(axis: str, fit: Fit | None, target: float) -> str:
    if fit is None:
        return f"{axis}: too few points for a curve."
    if fit.scale <= 0:
        return f"{axis}: more of them is no better here."
    where = fit.reaches(target)
    curve = f"FLIP = {fit.floor:.4f} + {fit.scale:.4f} * {axis}^-{fit.rate:.2f}, to within {fit.error:.1%}"
    return f"{curve}; {target:g} at {f'x {where:.3g}' if where is not None else 'no number of them'}."


def _means(config: PipelineConfig, options: argparse.Namespace) -> dict[str, float]:
    """Metrics of a config's weights, which are trained and evaluated if they do not exist yet."""
    file = options.output / f"{config.name}.toml"
    file.write_text(to_toml(to_dict(config)) + "\n", encoding="utf-8")
    command = [sys.executable, "-m", "z2p_renderer.pipeline.cli", "pipeline", "--config", file,
               "--meshes", options.meshes,
               "--evaluate-meshes", options.evaluate_meshes, "--workspace", options.workspace]  # fmt: skip
    subprocess.run([str(word) for word in command], check=True)
    means: dict[str, float] = json.loads((options.workspace / config.name / "metrics.json").read_text())["means"]
    return {metric: means[metric] for metric in METRICS}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=ROOT / "configs" / "growth.toml")
    parser.add_argument("--meshes", type=Path, required=True)
    parser.add_argument("--evaluate-meshes", type=Path, required=True)
    parser.add_argument("--workspace", type=Path, default=Path("runs"))
    parser.add_argument("--output", type=Path, default=Path("previews/growth"))
    parser.add_argument("--axes", nargs="+", choices=FACTORS, default=list(FACTORS))
    parser.add_argument("--target", type=float, default=0.07, help="FLIP to reach")
    return parser.parse_args()


if __name__ == "__main__":
    main()
