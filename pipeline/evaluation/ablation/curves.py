"""Plots the learning curves of all variants: one small panel each, with the base's curve behind."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from z2p_renderer.pipeline.evaluation.ablation.outcomes import VariantResult
from z2p_renderer.storage.files.atomic_write import atomic_write

COLUMNS = 4
"""Most panels in a row."""
BASE_COLOR = "#b8b8b8"
VARIANT_COLOR = "#00798c"


def draw_curves(outcomes: Sequence[VariantResult], path: Path) -> Path:
    """PNG of validation PSNR on the object (dB) against samples seen; the first outcome is the base."""
    from matplotlib.figure import Figure  # late: slow to import

    base, *others = outcomes
    columns = min(COLUMNS, len(others))
    rows = -(-len(others) // columns)
    figure = Figure(figsize=(3 * columns + 0.5, 2.3 * rows + 0.6), layout="constrained")
    panels = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    for panel, outcome in zip(panels, others, strict=False):
        for one, color, label in ((base, BASE_COLOR, "base"), (outcome, VARIANT_COLOR, "variant")):
            panel.plot(*zip(*one.curve, strict=True), color=color, linewidth=2, label=label)
        panel.set_title(outcome.variant.title, fontsize=9)
        panel.grid(alpha=0.25)
        panel.tick_params(labelsize=8)
    for unused in range(len(others), len(panels)):
        panels[unused].set_visible(False)
        panels[unused - columns].tick_params(labelbottom=True)  # the tick labels that the unused panel had
    figure.supxlabel("samples seen", fontsize=9)
    figure.supylabel("validation PSNR on the object, dB", fontsize=9)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize=8)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    atomic_write(buffer.getvalue(), path)
    return path
