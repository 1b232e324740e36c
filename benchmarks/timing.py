"""Times of one thing: how they are taken, and what is told of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

REPEATS = 9
BUDGET = 4.0
"""Seconds that one figure may take beyond its first run; slow baselines get fewer repeats."""


clocks: list[Callable[[], float]] = [time.perf_counter]
"""The last is the one that is read; `time.process_time` leaves out what other processes took of a busy machine."""


@dataclass(frozen=True)
class Figure:
    """Milliseconds of one thing, measured several times in this run."""

    what: str
    median: float
    low: float
    high: float
    """Quartiles."""
    repeats: int
    limit: float | None = None
    """What it should stay below, milliseconds on two quiet cores."""
    baseline: str | None = None
    """The figure of the same run that it is compared with."""
    floor: float | None = None
    """What the machine's memory allows, milliseconds."""

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def measure(
    what: str, run: Callable[[], object], limit: float | None = None, baseline: str | None = None,
    floor: float | None = None, repeats: int = REPEATS, warm: bool = True,
) -> Figure:
    """Times of `run`, called `repeats` times or as often as fits into the budget; once more before, to warm up."""
    clock = clocks[-1]
    if warm:
        run()
    times: list[float] = []
    began = time.perf_counter()
    while len(times) < repeats and (not times or time.perf_counter() - began < BUDGET):
        start = clock()
        run()
        times.append(1e3 * (clock() - start))
    low, high = (min(times), max(times)) if len(times) < 4 else statistics.quantiles(times, n=4)[::2]
    return Figure(what, statistics.median(times), low, high, len(times), limit, baseline, floor)


def table(figures: list[Figure]) -> str:
    """The figures as a Markdown table: median, quartiles, limit, floor and how many times as fast as the baseline."""
    medians = {figure.what: figure.median for figure in figures}
    lines = ["| what | median ms | quartiles | limit | floor | ratio |", "|---|--:|--:|--:|--:|---|"]
    for one in figures:
        ratio = ""
        if one.baseline in medians:
            ratio = f"{medians[one.baseline] / one.median:.3g} x {one.baseline}"
        limit, floor = ("" if number is None else f"{number:.3g}" for number in (one.limit, one.floor))
        over = " !" if one.limit is not None and one.median > one.limit else ""
        lines.append(f"| {one.what} | {one.median:.3g}{over} | {one.low:.3g} to {one.high:.3g} | {limit} | {floor} "
                     f"| {ratio} |")
    return "\n".join(lines)
