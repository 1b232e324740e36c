"""Results of each variant: its metrics against the base's, its size, its time, and a verdict."""

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
"""The metric that decides whether a variant is better or worse, dB; more is better."""
BETTER = "better"
WORSE = "worse"
NO_DIFFERENCE = "no difference that can be told"
Folders = Mapping[str, tuple[Path, Path]]
"""Variant -> folders of its training and evaluation results."""


@dataclass(frozen=True)
class MetricDifference:
    """A variant's metric minus the base's, on the same clouds and views."""

    mean: float
    error: float | None
    """Standard error of the mean over the meshes; None for a single mesh."""


@dataclass(frozen=True)
class VariantResult:
    """A variant's results."""

    variant: Variant
    means: Mapping[str, float]
    """Metric of `z2p_core.quality.metrics` -> mean over all rows; also ``seconds`` per picture."""
    differences: Mapping[str, MetricDifference]
    """Metric -> difference to the base; empty for the base itself."""
    weights: int
    """Number of parameters of the network."""
    samples: int
    """Training samples seen."""
    seconds: float | None
    """Seconds of its training, on whatever machine and under whatever load; None if it was interrupted and resumed."""
    curve: Sequence[tuple[float, float]]
    """(samples seen, validation PSNR on the object in dB)."""
    results: tuple[str, ...]
    """Paths of its training and evaluation results, relative to the workspace."""

    def verdict(self, chance: float | None) -> str:
        """`BETTER` or `WORSE` if the difference exceeds both `chance` and two standard errors, else `NO_DIFFERENCE`.

        `chance` is the effect of other seeds, dB. If neither it nor the error is known, there is no difference.
        """
        difference = self.differences.get(DECIDING_METRIC)
        if difference is None or (chance is None and difference.error is None):
            return NO_DIFFERENCE
        if abs(difference.mean) <= max(chance or 0, 2 * (difference.error or 0)):
            return NO_DIFFERENCE
        return BETTER if difference.mean > 0 else WORSE


def read_variant_results(config: AblationsConfig, folders: Folders) -> list[VariantResult]:
    """The result of every variant, in the config's order.

    Raises:
        OSError: a result is missing.
        WeightsError: weights are damaged.
    """
    base = _read_rows(folders[BASE][1])
    return [_read_variant_result(variant, *folders[variant.name], base) for variant in config.variants]


def seed_variation(outcomes: Sequence[VariantResult]) -> float | None:
    """Largest change of the deciding metric, dB, between runs that differ in the seed alone; None if there are none."""
    repeats = [one.differences.get(DECIDING_METRIC) for one in outcomes if one.variant.is_repeat]
    return max((abs(one.mean) for one in repeats if one), default=None)


def _read_variant_result(
    variant: Variant, train: Path, evaluate: Path, base: Mapping[Any, Mapping[str, Any]]
) -> VariantResult:
    own, training = _read_rows(evaluate), variant.config.train
    sides = training.resolutions or (variant.config.shard.resolution,)
    tensors = load_weights(train / "weights.safetensors").tensors
    changes = {} if variant.name == BASE else {name: paired_difference(own, base, name) for name in METRIC_NAMES}
    return VariantResult(
        variant=variant,
        means=json.loads((evaluate / "metrics.json").read_text(encoding="utf-8"))["means"],
        differences={name: change for name, change in changes.items() if change},
        weights=sum(tensor.size for tensor in tensors.values()),
        samples=samples_until(training.steps, training.batch, sides),
        seconds=training_seconds(train / "task.log"),
        curve=read_curve(train / "curve.csv"),
        results=tuple(f"{folder.parent.name}/{folder.name}" for folder in (train, evaluate)),
    )


def paired_difference(own: Mapping[Any, Any], base: Mapping[Any, Any], name: str) -> MetricDifference | None:
    """Mean over meshes of metric `name`'s difference, from the rows by (mesh, ...) that both have; None without any.

    Views of one mesh are correlated, so the standard error is taken over meshes.
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


def training_seconds(log: Path) -> float | None:
    """Seconds of a task by its log; None if the log lacks them or has several starts."""
    text = log.read_text(encoding="utf-8", errors="replace") if log.is_file() else ""
    durations = re.findall(r": done in ([\d.]+) s$", text, flags=re.MULTILINE)
    starts = re.findall(r": started$", text, flags=re.MULTILINE)
    return float(durations[0]) if len(durations) == len(starts) == 1 else None


def read_curve(path: Path) -> list[tuple[float, float]]:
    """(samples seen, validation PSNR on the object in dB) of each row of a training's curve.csv that has it."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = [(row["samples"], row.get("validation_psnr_foreground")) for row in csv.DictReader(file)]
    return [(float(samples), float(value)) for samples, value in rows if value]


def _read_rows(evaluate: Path) -> dict[Any, dict[str, Any]]:
    rows = json.loads((evaluate / "metrics.json").read_text(encoding="utf-8"))["rows"]
    return {(row["mesh"], row["seed"], row["view"]): row for row in rows}
