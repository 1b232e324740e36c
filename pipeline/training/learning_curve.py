"""What a training run writes for people: the learning curve (CSV and PNG) and strips of validation images."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from z2p_core.images import bytes_from_unit
from z2p_core.quality.losses import rgb_on_white
from z2p_renderer.storage.files.atomic_write import atomic_path, atomic_write

Row = dict[str, float]
"""One row of the curve: column name to value."""


def write_validation_strip(path: Path, buffers: Tensor, prediction: Tensor, target: Tensor) -> None:
    """A PNG with a row for each sample: first z-buffer channel, prediction on white, target on white."""
    zbuffer = buffers[:, :1].clamp(0, 1).expand(-1, 3, -1, -1)
    images = [zbuffer, rgb_on_white(prediction), rgb_on_white(target)]
    columns = torch.cat(images, dim=3).clamp(0, 1).cpu()  # (B, 3, H, 3W)
    image = np.concatenate([row.permute(1, 2, 0).numpy() for row in columns])
    with atomic_path(path) as temporary:
        Image.fromarray(bytes_from_unit(image)).save(temporary, format="PNG")


def write_learning_curve(folder: Path, rows: Sequence[Row]) -> None:
    """`curve.csv` with a line per row (empty where the row lacks a column), and `curve.png` of the same numbers."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in rows)
    atomic_write(text.getvalue().encode(), folder / "curve.csv")
    _plot_curve(folder / "curve.png", rows, columns)


def _plot_curve(path: Path, rows: Sequence[Row], columns: Sequence[str]) -> None:
    from matplotlib.figure import Figure  # late: slow to import, and only training draws curves

    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name in columns:
        points = [(row["step"], row[name]) for row in rows if name in row]
        if name in ("validation_psnr_white", "validation_psnr_foreground"):
            right.plot(*zip(*points, strict=True), label=name.removeprefix("validation_"))
        elif name not in ("step", "samples", "learning_rate") and not name.startswith("validation_"):
            left.plot(*zip(*points, strict=True), label=name, linewidth=2 if name == "loss" else 1)
    left.set(xlabel="step", yscale="log", title="training loss")
    right.set(xlabel="step", ylabel="dB", title="validation")
    for axes in (left, right):
        if axes.lines:
            axes.legend(fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=100)
