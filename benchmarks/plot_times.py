"""Plots times with their limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path


def plot_times(
    path: Path, label: str, at: Sequence[int], lines: Mapping[str, Sequence[float]], limits: Mapping[int, float]
) -> None:
    """Writes a log-log plot of milliseconds against `at`, a line per name; the limits are a dashed line."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    for name, times in lines.items():
        axes.loglog(at, times, marker="o", label=name)
    axes.loglog(list(limits), list(limits.values()), "k--", marker="_", label="limit (two quiet cores)")
    axes.set(xlabel=label, ylabel="milliseconds")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
