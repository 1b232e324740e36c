"""What more samples seen, more renders and more channels bring: trains at several of each, and fits curves.

    python scripts/measure_growth.py --meshes DIR --evaluate-meshes DIR [--config configs/growth.toml] [--output DIR]

Needs the pipeline extra. Each point is a `z2p pipeline` of its own, so what is finished is not run again. Prints a
table, and what curves FLIP = floor + scale * x^-rate say would reach `--target`; writes growth.md and growth.json.
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
TIMES: dict[str, tuple[float, ...]] = {
    "samples": (1 / 4, 1 / 2, 1, 2), "renders": (1 / 8, 1 / 4, 1 / 2, 1), "channels": (1 / 2, 3 / 4, 1, 3 / 2),
}  # fmt: skip
"""Axis -> how many times as much of it as the config has. With fewer samples still, a training has hardly begun."""
RATES = np.linspace(0.05, 2, 196)
"""Exponents that a fit may have."""
LEAST = 4
"""Points that a fit of three numbers needs at least."""
FIGURES = ("flip", "psnr_foreground", "ssim", "alpha_l1")


class Fit(NamedTuple):
    """A curve `floor + scale * x**-rate`, and the root mean square of its errors, as shares of its points."""

    floor: float
    scale: float
    rate: float
    left: float

    def reaches(self, target: float) -> float | None:
        """The x at which the curve comes down to the target; None where it never does."""
        if target <= self.floor or self.scale <= 0:
            return None
        return float((self.scale / (target - self.floor)) ** (1 / self.rate))


def main() -> None:
    """Run what is missing, fit, print and write."""
    options = _options()
    base = parse_config(options.config.read_text(encoding="utf-8"), str(options.config))
    options.output.mkdir(parents=True, exist_ok=True)
    measured = {
        axis: [{"times": times, **_means(varied(base, axis, times), options)} for times in TIMES[axis]]
        for axis in options.axes
    }
    text = told(measured, options.target)
    print(text)
    (options.output / "growth.md").write_text(text, encoding="utf-8")
    (options.output / "growth.json").write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")


def varied(base: PipelineConfig, axis: str, times: float) -> PipelineConfig:
    """The config with so many times the samples, renders or channels; with 1 it is the base, shared by all axes."""
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


def toml(table: Mapping[str, Any], path: str = "") -> str:
    """A nested dict as TOML; what is None is left out."""
    values = [f"{key} = {json.dumps(value)}" for key, value in table.items()
              if value is not None and not isinstance(value, dict)]  # fmt: skip
    deeper = [(f"{path}.{key}".lstrip("."), value) for key, value in table.items() if isinstance(value, dict)]
    return "\n".join([*values, *(f"\n[{name}]\n{toml(value, name)}" for name, value in deeper)])


def fitted(points: Sequence[tuple[float, float]]) -> Fit | None:
    """The curve nearest to points (x, y), whose floor is not below 0; None for fewer than `LEAST`."""
    if len(points) < LEAST:
        return None
    x, y = np.array(points, dtype=float).T
    fits = []
    for rate in RATES:
        power = x**-rate
        scale, floor = np.polyfit(power, y, 1, w=1 / y)
        if floor < 0:
            floor, scale = 0.0, float((power / y).sum() / ((power / y) ** 2).sum())
        left = float(np.sqrt(np.mean(((floor + scale * power) / y - 1) ** 2)))
        fits.append(Fit(float(floor), float(scale), float(rate), left))
    return min(fits, key=lambda fit: fit.left)


def told(measured: Mapping[str, Sequence[Mapping[str, float]]], target: float) -> str:
    """The figures and fits in Markdown."""
    lines = []
    for axis, points in measured.items():
        lines += [f"| {axis} | FLIP | object, dB | SSIM | alpha L1 |", "|--:" * 5 + "|"]
        lines += [
            f"| x {point['times']:g} | {point['flip']:.4f} | {point['psnr_foreground']:.2f} | {point['ssim']:.4f} | "
            f"{point['alpha_l1']:.5f} |" for point in points
        ]  # fmt: skip
        lines += ["", _conclusion(axis, fitted([(point["times"], point["flip"]) for point in points]), target), ""]
    return "\n".join(lines)


def _conclusion(axis: str, fit: Fit | None, target: float) -> str:
    if fit is None:
        return f"{axis}: too few points for a curve."
    if fit.scale <= 0:
        return f"{axis}: more of them is no better here."
    where = fit.reaches(target)
    curve = f"FLIP = {fit.floor:.4f} + {fit.scale:.4f} * {axis}^-{fit.rate:.2f}, to within {fit.left:.1%}"
    return f"{curve}; {target:g} at {f'x {where:.3g}' if where is not None else 'no number of them'}."


def _means(config: PipelineConfig, options: argparse.Namespace) -> dict[str, float]:
    """Figures of a config's weights, trained and measured now if they are not there yet."""
    file = options.output / f"{config.name}.toml"
    file.write_text(toml(to_dict(config)) + "\n", encoding="utf-8")
    command = [sys.executable, "-m", "z2p_renderer.pipeline.cli", "pipeline", "--config", file,
               "--meshes", options.meshes,
               "--evaluate-meshes", options.evaluate_meshes, "--workspace", options.workspace]  # fmt: skip
    subprocess.run([str(word) for word in command], check=True)
    told: dict[str, float] = json.loads((options.workspace / config.name / "metrics.json").read_text())["means"]
    return {figure: told[figure] for figure in FIGURES}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=ROOT / "configs" / "growth.toml")
    parser.add_argument("--meshes", type=Path, required=True)
    parser.add_argument("--evaluate-meshes", type=Path, required=True)
    parser.add_argument("--workspace", type=Path, default=Path("runs"))
    parser.add_argument("--output", type=Path, default=Path("previews/growth"))
    parser.add_argument("--axes", nargs="+", choices=TIMES, default=list(TIMES))
    parser.add_argument("--target", type=float, default=0.07, help="FLIP to reach")
    return parser.parse_args()


if __name__ == "__main__":
    main()
