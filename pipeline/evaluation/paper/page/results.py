"""All measured rows of a report, and the means, spreads and winners that are told of them."""

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
"""Figure -> its title, how it is told, and whether more is better."""
CONTRAST_KEPT = "contrast_kept"
"""Best at 1: below it contrast is lost, above it there is more than in truth."""


@dataclass(frozen=True)
class Results:
    """Rows of every method, sweep and mesh; each has ``sweep``, ``mesh``, ``method`` and ``result``, its folder."""

    every: tuple[dict[str, Any], ...]
    methods: tuple[Method, ...]

    def rows(self, sweep: str, method: str, level: str | None = None) -> list[dict[str, Any]]:
        """Rows of a method in a sweep, at one level or all."""
        return [row for row in self.every if row["sweep"] == sweep and row["method"] == method
                and (level is None or row["level"] == level)]  # fmt: skip

    def levels(self, sweep: str) -> list[str]:
        """The sweep's levels in order."""
        return list(dict.fromkeys(row["level"] for row in self.every if row["sweep"] == sweep))

    def meshes(self, sweep: str) -> list[str]:
        """Names of the meshes in a sweep."""
        return list(dict.fromkeys(row["mesh"] for row in self.every if row["sweep"] == sweep))

    def values(self, sweep: str, method: str, figure: str, level: str | None = None) -> list[float]:
        """The figure of every row that has it."""
        return [row[figure] for row in self.rows(sweep, method, level) if figure in row]

    def curve(self, sweep: str, method: str, figure: str) -> list[tuple[str, float]]:
        """Level and mean of the figure, for each level that has it."""
        found = [(level, mean(self.values(sweep, method, figure, level))) for level in self.levels(sweep)]
        return [(level, value) for level, value in found if value is not None]

    def by_mesh(self, sweep: str, method: str, figure: str) -> dict[str, float]:
        """Mesh -> mean of the figure."""
        found = {}
        for mesh in self.meshes(sweep):
            value = mean([row[figure] for row in self.rows(sweep, method) if row["mesh"] == mesh and figure in row])
            if value is not None:
                found[mesh] = value
        return found

    def named(self, kind: str) -> list[str]:
        """Names of the methods of a kind, in order."""
        return [method.name for method in self.methods if method.kind == kind]


@dataclass(frozen=True)
class Comparison:
    """The best weights against the best baseline in one figure at one place."""

    sweep: str
    level: str
    figure: str
    ours: str
    our_value: float
    theirs: str
    their_value: float

    @property
    def lost(self) -> bool:
        """Whether the baseline wins."""
        more = METRICS[self.figure][2]
        return self.their_value > self.our_value if more else self.their_value < self.our_value


def read_results(folders: Mapping[str, Path], methods: Sequence[Method]) -> Results:
    """Findings of the folders of measured results, by the names of their steps."""
    every = []
    for name, folder in folders.items():
        if not name.startswith(("measure/", "scans/")):
            continue
        told = json.loads((folder / ROWS_FILE).read_text(encoding="utf-8"))
        kind, *parts = name.split("/")  # names of today: files may have others since a result was made
        sweep, of, method = parts if kind == "measure" else (told["sweep"], told["mesh"], *parts)
        where = {"sweep": sweep, "mesh": told["mesh"] and of, "method": method,
                 "result": f"{folder.parent.name}/{folder.name}"}  # fmt: skip
        every += [{**row, **where} for row in told["rows"]]
    return Results(tuple(every), tuple(methods))


def compare_best(findings: Results, sweep: str) -> list[Comparison]:
    """A duel for each level and figure of a sweep that weights and baselines both have."""
    found = []
    for level in findings.levels(sweep):
        for figure, (_, _, more) in METRICS.items():
            best = []
            for kind in (WEIGHTS, BASELINE):
                means = {name: mean(findings.values(sweep, name, figure, level)) for name in findings.named(kind)}
                known = {name: value for name, value in means.items() if value is not None}
                if known:
                    name = (max if more else min)(known, key=lambda one: known[one])
                    best.append((name, known[name]))
            if len(best) == 2:
                found.append(Comparison(sweep, level, figure, *best[0], *best[1]))
    return found


def best_value(figure: str, values: Sequence[float]) -> float | None:
    """The best of values of a figure; None of nothing."""
    if figure == CONTRAST_KEPT:
        return min(values, key=lambda value: abs(1 - value), default=None)
    more = figure in METRICS and METRICS[figure][2]
    return (max if more else min)(values, default=None)


def mean(values: Sequence[float]) -> float | None:
    """The mean; None of nothing."""
    return statistics.fmean(values) if values else None


def spread(values: Sequence[float]) -> float | None:
    """The standard deviation; None of nothing."""
    return statistics.pstdev(values) if values else None
