"""Times calls, and formats the times as a table."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

REPEATS = 9
BUDGET_SECONDS = 4.0
"""Time for the repeats of one call; slow ones get fewer repeats."""


clocks: list[Callable[[], float]] = [time.perf_counter]
"""The last one is used; `time.process_time` excludes the time of other processes on a busy machine."""


@dataclass(frozen=True)
class Timing:
    """Milliseconds of one repeated call."""

    what: str
    median: float
    low: float
    high: float
    """Quartiles."""
    repeats: int
    limit: float | None = None
    """Upper limit, milliseconds on two quiet cores."""
    baseline: str | None = None
    """Name of the timing of the same run to compare with."""
    floor: float | None = None
    """Lower bound by memory bandwidth, milliseconds."""

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def time_call(
    what: str,
    run: Callable[[], object],
    limit: float | None = None,
    baseline: str | None = None,
    floor: float | None = None,
    repeats: int = REPEATS,
    warm: bool = True,
) -> Timing:
    """Times `run`, called `repeats` times or as often as fits into `BUDGET_SECONDS`, after one warm-up call."""
    clock = clocks[-1]
    if warm:
        run()
    times: list[float] = []
    began = time.perf_counter()
    while len(times) < repeats and (not times or time.perf_counter() - began < BUDGET_SECONDS):
        start = clock()
        run()
        times.append(1e3 * (clock() - start))
    low, high = (min(times), max(times)) if len(times) < 4 else statistics.quantiles(times, n=4)[::2]
    return Timing(what, statistics.median(times), low, high, len(times), limit, baseline, floor)


def markdown_table(timings: list[Timing]) -> str:
    """Timings as a Markdown table: median, quartiles, limit, floor, and speed relative to the baseline."""
    medians = {timing.what: timing.median for timing in timings}
    lines = ["| what | median ms | quartiles | limit | floor | ratio |", "|---|--:|--:|--:|--:|---|"]
    for one in timings:
        ratio = ""
        if one.baseline in medians:
            ratio = f"{medians[one.baseline] / one.median:.3g} x {one.baseline}"
        limit, floor = ("" if number is None else f"{number:.3g}" for number in (one.limit, one.floor))
        over = " !" if one.limit is not None and one.median > one.limit else ""
        lines.append(
            f"| {one.what} | {one.median:.3g}{over} | {one.low:.3g} to {one.high:.3g} | {limit} | {floor} | {ratio} |"
        )
    return "\n".join(lines)
