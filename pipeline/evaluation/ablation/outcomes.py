"""What became of each variant: its figures beside the base's, its size, its time, and what may be concluded."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.config.ablation import BASE, AblationsConfig, Variant
from z2p_core.config.pipeline import samples_until
from z2p_core.quality.metrics import METRIC_NAMES
from z2p_renderer.storage.models.checkpoints import load_weights

DECIDING_METRIC = "psnr_foreground"
"""The figure by which a variant is better or worse, dB; more is better."""
BETTER, WORSE, NO_DIFFERENCE = "better", "worse", "no difference that can be told"
Folders = Mapping[str, tuple[Path, Path]]
"""Variant -> folders of its training's and its evaluation's results."""


@dataclass(frozen=True)
class MetricDifference:
    """A variant's figure less the base's, on the same clouds and views."""

    mean: float
    error: float | None
    """Standard error of the mean over the meshes; None of one mesh."""


@dataclass(frozen=True)
class VariantResult:
    """A variant's results."""

    variant: Variant
    means: Mapping[str, float]
    """Figure of `z2p_core.quality.metrics` -> mean over all rows; ``seconds``, of drawing a picture, beside them."""
    differences: Mapping[str, MetricDifference]
    """Figure -> difference to the base; none of the base itself."""
    weights: int
    """Numbers in the network."""
    samples: int
    """Samples that it has seen."""
    seconds: float | None
    """Seconds of its training, on whatever machine and beside whatever ran; None when it was stopped and went on."""
    curve: Sequence[tuple[float, float]]
    """(samples seen, validation PSNR on the object in dB)."""
    results: tuple[str, ...]
    """Its results, below the workspace: training and evaluation."""

    def verdict(self, chance: float | None) -> str:
        """``better``, ``worse``, or neither where `chance` or two standard errors reach as far as the difference.

        Where neither is known nothing can be told.
        """
        found = self.differences.get(DECIDING_METRIC)
        if found is None or (chance is None and found.error is None):
            return NO_DIFFERENCE
        if abs(found.mean) <= max(chance or 0, 2 * (found.error or 0)):
            return NO_DIFFERENCE
        return BETTER if found.mean > 0 else WORSE


def read_variant_results(config: AblationsConfig, folders: Folders) -> list[VariantResult]:
    """The outcome of every variant, in the config's order.

    Raises:
        OSError: a result is missing.
        WeightsError: weights are damaged.
    """
    base = _rows(folders[BASE][1])
    return [_outcome(variant, *folders[variant.name], base) for variant in config.variants]


def chance_of(outcomes: Sequence[VariantResult]) -> float | None:
    """Largest change of the deciding figure, dB, by nothing but other random numbers; None when none were tried."""
    repeats = [one.differences.get(DECIDING_METRIC) for one in outcomes if one.variant.is_repeat]
    return max((abs(one.mean) for one in repeats if one), default=None)


def _outcome(variant: Variant, train: Path, evaluate: Path, base: Mapping[Any, Mapping[str, Any]]) -> VariantResult:
    own, training = _rows(evaluate), variant.config.train
    sides = training.resolutions or (variant.config.shard.resolution,)
    tensors = load_weights(train / "weights.safetensors").tensors
    differences = {name: found for name in METRIC_NAMES if variant.name != BASE and (found := difference(own, base, name))}
    return VariantResult(
        variant=variant,
        means=json.loads((evaluate / "metrics.json").read_text(encoding="utf-8"))["means"],
        differences=differences,
        weights=sum(tensor.size for tensor in tensors.values()),
        samples=samples_until(training.steps, training.batch, sides),
        seconds=seconds_of(train / "task.log"),
        curve=read_curve(train / "curve.csv"),
        results=tuple(f"{folder.parent.name}/{folder.name}" for folder in (train, evaluate)),
    )


def difference(own: Mapping[Any, Any], base: Mapping[Any, Any], name: str) -> MetricDifference | None:
    """The mean over meshes of a figure's differences, of rows by (mesh, ...) that both have; None without any.

    Views of a mesh resemble each other, so the meshes are what the standard error counts.
    """
    meshes: dict[str, list[float]] = {}
    for key in own.keys() & base.keys():
        pair = own[key].get(name), base[key].get(name)
        if None not in pair:
            meshes.setdefault(key[0], []).append(pair[0] - pair[1])
    if not meshes:
        return None
    means = np.array([np.mean(meshes[mesh]) for mesh in sorted(meshes)])
    error = float(means.std(ddof=1) / len(means) ** 0.5) if len(means) > 1 else None
    return MetricDifference(float(means.mean()), error)


def seconds_of(log: Path) -> float | None:
    """Seconds that a task took by its log; None when that does not tell, or tells of several starts."""
    text = log.read_text(encoding="utf-8", errors="replace") if log.is_file() else ""
    found = re.findall(r": done in ([\d.]+) s$", text, flags=re.MULTILINE)
    starts = re.findall(r": started$", text, flags=re.MULTILINE)
    return float(found[0]) if len(found) == len(starts) == 1 else None


def read_curve(path: Path) -> list[tuple[float, float]]:
    """(samples seen, validation PSNR on the object in dB) of each row of a training's curve.csv that has it."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = [(row["samples"], row.get("validation_psnr_foreground")) for row in csv.DictReader(file)]
    return [(float(samples), float(value)) for samples, value in rows if value]


def _rows(evaluate: Path) -> dict[Any, dict[str, Any]]:
    rows = json.loads((evaluate / "metrics.json").read_text(encoding="utf-8"))["rows"]
    return {(row["mesh"], row["seed"], row["view"]): row for row in rows}
