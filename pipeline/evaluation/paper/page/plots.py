"""Images embedded in the page as data URIs: curves as SVG, thumbnails as WebP."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

from PIL import Image

from z2p_renderer.pipeline.evaluation.paper.methods import WEIGHTS
from z2p_renderer.pipeline.evaluation.paper.page.results import CONTRAST_KEPT, METRICS, Results, mean, spread

THUMBNAIL_SIDE = 144
"""Longest side of a thumbnail, pixels."""
LINE_COLORS = ("#d1495b", "#00798c", "#edae49", "#66a182", "#5b5ea6", "#8d6a4f", "#2e4057", "#c77dba")
METRIC_TITLES = {name: title for name, (title, _, _) in METRICS.items()} | {CONTRAST_KEPT: "contrast kept"}


def plot_sweep(results: Results, sweep: str, axis: str, log: bool, metrics: Sequence[str]) -> str:
    """Data URI of a plot: a panel per metric, a line per method; error bars are the standard deviation over rows."""
    from matplotlib.figure import Figure  # late: slow to import

    figure = Figure(figsize=(3.7 * len(metrics) + 1, 3.1), layout="constrained")
    panels = figure.subplots(1, len(metrics), squeeze=False)[0]
    levels = results.levels(sweep)
    for panel, metric in zip(panels, metrics, strict=True):
        shown = [level for level in levels if _is_measured(results, sweep, level, metric)]
        numeric = all(_is_number(level) for level in shown)
        for color, method in zip(cycle(LINE_COLORS), (one.name for one in results.methods), strict=False):
            points = [(level, results.values(sweep, method, metric, level)) for level in shown]
            known = [(level, values) for level, values in points if values]
            if not known:
                continue
            places = [float(level) if numeric else shown.index(level) for level, _ in known]
            ours = method in results.named(WEIGHTS)
            panel.errorbar(places, [mean(values) for _, values in known], [spread(values) for _, values in known],
                           label=method, color=color, linewidth=2.4 if ours else 1.2, marker="o", markersize=3,
                           elinewidth=0.6, alpha=1 if ours else 0.8)  # fmt: skip
        panel.set_title(METRIC_TITLES[metric], fontsize=10)
        panel.set_xlabel(axis, fontsize=9)
        panel.grid(alpha=0.25)
        if numeric and log:
            panel.set_xscale("log")
            panel.set_xticks([float(level) for level in shown], shown, rotation=25, fontsize=8)
            panel.minorticks_off()
        if not numeric:
            panel.set_xticks(range(len(shown)), shown, rotation=25, fontsize=8)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return f"data:image/svg+xml;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def thumbnail(path: Path) -> str:
    """Data URI of a downsampled picture."""
    with Image.open(path) as image:
        small = image.convert("RGBA")
    small.thumbnail((THUMBNAIL_SIDE, THUMBNAIL_SIDE), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    small.save(buffer, format="WEBP", quality=85, method=2)
    return f"data:image/webp;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _is_measured(results: Results, sweep: str, level: str, metric: str) -> bool:
    return any(metric in row for row in results.every if row["sweep"] == sweep and row["level"] == level)


def _is_number(level: str) -> bool:
    try:
        float(level)
    except ValueError:
        return False
    return True
