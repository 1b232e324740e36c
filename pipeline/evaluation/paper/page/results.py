"""All measured rows of a report, and statistics over them: means, spreads, best methods."""

from __future__ import annotations

import json
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from z2p_renderer.pipeline.evaluation.paper.measure import ROWS_FILE
from z2p_renderer.pipeline.evaluation.paper.methods import BASELINE, WEIGHTS, Method

METRICS: dict[str, tuple[str, str, bool]] = {
    "psnr_foreground": ("PSNR on the object", "{:.2f} dB", True),
    "psnr_white": ("PSNR on white", "{:.2f} dB", True),
    "ssim": ("SSIM", "{:.4f}", True),
    "flip": ("FLIP", "{:.4f}", False),
}
"""Metric -> its title, its format, and whether more is better."""
CONTRAST_KEPT = "contrast_kept"
"""Metric whose best value is 1: below it contrast is lost, above it is exaggerated."""


@dataclass(frozen=True)
class Results:
    """Rows of every method, sweep and mesh; each has ``sweep``, ``mesh``, ``method`` and ``result`` (its folder)."""

    every: tuple[dict[str, Any], ...]
    methods: tuple[Method, ...]

    def rows(self, sweep: str, method: str, level: str | None = None) -> list[dict[str, Any]]:
        """Rows of a method in a sweep, at one level or at all."""
        return [row for row in self.every if row["sweep"] == sweep and row["method"] == method
                and (level is None or row["level"] == level)]  # fmt: skip

    def levels(self, sweep: str) -> list[str]:
        """The sweep's levels in order."""
        return list(dict.fromkeys(row["level"] for row in self.every if row["sweep"] == sweep))

    def meshes(self, sweep: str) -> list[str]:
        """Names of the meshes in a sweep."""
        return list(dict.fromkeys(row["mesh"] for row in self.every if row["sweep"] == sweep))

    def values(self, sweep: str, method: str, metric: str, level: str | None = None) -> list[float]:
        """The metric of every row that has it."""
        return [row[metric] for row in self.rows(sweep, method, level) if metric in row]

    def curve(self, sweep: str, method: str, metric: str) -> list[tuple[str, float]]:
        """(level, mean of the metric) for each level that has it."""
        means = [(level, mean(self.values(sweep, method, metric, level))) for level in self.levels(sweep)]
        return [(level, value) for level, value in means if value is not None]

    def by_mesh(self, sweep: str, method: str, metric: str) -> dict[str, float]:
        """Mesh -> mean of the metric."""
        means = {}
        for mesh in self.meshes(sweep):
            value = mean([row[metric] for row in self.rows(sweep, method) if row["mesh"] == mesh and metric in row])
            if value is not None:
                means[mesh] = value
        return means

    def named(self, kind: str) -> list[str]:
        """Names of the methods of a kind, in order."""
        return [method.name for method in self.methods if method.kind == kind]


@dataclass(frozen=True)
class Comparison:
    """The best weights against the best baseline in one metric, at one level of a sweep."""

    sweep: str
    level: str
    metric: str
    ours: str
    our_value: float
    theirs: str
    their_value: float

    @property
    def lost(self) -> bool:
        """Whether the baseline wins."""
        more = METRICS[self.metric][2]
        return self.their_value > self.our_value if more else self.their_value < self.our_value


def read_results(folders: Mapping[str, Path], methods: Sequence[Method]) -> Results:
    """Rows of the folders of measured results, given by their steps' names."""
    every = []
    for name, folder in folders.items():
        if not name.startswith(("measure/", "scans/")):
            continue
        content = json.loads((folder / ROWS_FILE).read_text(encoding="utf-8"))
        kind, *parts = name.split("/")  # the steps' names, not the files': meshes may have been renamed since
        sweep, of, method = parts if kind == "measure" else (content["sweep"], content["mesh"], *parts)
        where = {"sweep": sweep, "mesh": content["mesh"] and of, "method": method,
                 "result": f"{folder.parent.name}/{folder.name}"}  # fmt: skip
        every += [{**row, **where} for row in content["rows"]]
    return Results(tuple(every), tuple(methods))


def compare_best(findings: Results, sweep: str) -> list[Comparison]:
    """A comparison for each level and metric of a sweep that both weights and baselines have."""
    comparisons = []
    for level in findings.levels(sweep):
        for metric, (_, _, more) in METRICS.items():
            best = []
            for kind in (WEIGHTS, BASELINE):
                means = {name: mean(findings.values(sweep, name, metric, level)) for name in findings.named(kind)}
                known = {name: value for name, value in means.items() if value is not None}
                if known:
                    name = (max if more else min)(known, key=lambda one: known[one])
                    best.append((name, known[name]))
            if len(best) == 2:
                comparisons.append(Comparison(sweep, level, metric, *best[0], *best[1]))
    return comparisons


def best_value(metric: str, values: Sequence[float]) -> float | None:
    """The best of a metric's values; None if there are none."""
    if metric == CONTRAST_KEPT:
        return min(values, key=lambda value: abs(1 - value), default=None)
    more = metric in METRICS and METRICS[metric][2]
    return (max if more else min)(values, default=None)


def mean(values: Sequence[float]) -> float | None:
    """The mean; None if there are no values."""
    return statistics.fmean(values) if values else None


def spread(values: Sequence[float]) -> float | None:
    """The standard deviation; None if there are no values."""
    return statistics.pstdev(values) if values else None
