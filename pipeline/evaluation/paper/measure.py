"""Runs one method on one sweep of one mesh: pictures, and a row of metrics for each."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from z2p_core.camera import Camera
from z2p_core.config.report import ReportConfig
from z2p_core.images import bytes_from_unit, composite
from z2p_core.quality.metrics import image_metrics
from z2p_renderer.pipeline.evaluation.paper.cases.ground_truth import render_case_truths
from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import Case, TrueMesh, sweep_cases
from z2p_renderer.pipeline.evaluation.paper.methods import TRUTH, Method, MethodImage, draw_cases
from z2p_renderer.pipeline.outputs.point_preview import draw_dots
from z2p_renderer.pipeline.rendering.views import place_in_scene

ROWS_FILE = "rows.json"
WHITE = (1.0, 1.0, 1.0)
FLOOR_COVERAGE = 0.01
"""Coverage below which a pixel shows the floor, where shadows are measured."""
Log = Callable[[str], None]
Truths = Sequence[tuple[np.ndarray, np.ndarray]]


def measure(
    sweep: str,
    subject: TrueMesh | None,
    method: Method,
    config: ReportConfig,
    truth_root: Path,
    out: Path,
    log: Log = lambda line: None,
) -> Path:
    """Writes ``out/rows.json``: a row per level and view with its picture's name in `out`; nan metrics are left out.

    For the ground truth the pictures are Blender's, and ``input_NN.png`` shows the points.

    Raises:
        ScanError, WeightsError, PluginError: the mesh or the method cannot be used.
        RenderError: Blender failed, or a stored render is damaged.
    """
    cases = sweep_cases(sweep, subject, config)
    truths = render_case_truths(cases, config, truth_root, log)
    if method.kind == TRUTH:
        drawn = [MethodImage(picture) for picture, _ in truths]
        for index, case in enumerate(cases):
            _save(draw_points(case, config.resolution), out / f"input_{index:02}.png")
    else:
        drawn = draw_cases(method, cases, config, truth_root, log)
    rows = []
    for index, (case, one) in enumerate(zip(cases, drawn, strict=True)):
        row: dict[str, Any] = {"level": case.level, "x": case.x, "view": case.view, "points": len(case.cloud)}
        if one.picture is not None:
            row["picture"] = f"{index:02}.png"
            _save(one.picture, out / row["picture"])
            if method.kind != TRUTH:
                row |= case_metrics(one.picture, *truths[index]) | _contrast_kept(cases, index, drawn, truths)
        row |= {"seconds": one.seconds, "steps": dict(one.steps)} if one.seconds is not None else {}
        rows.append(row | ({"error": one.error} if one.error else {}))
        log(
            f"{sweep} {subject.name if subject else 'own shapes'} {case.level} {method.name}: {_describe_row(rows[-1])}"
        )
    path = out / ROWS_FILE
    path.write_text(json.dumps({"sweep": sweep, "mesh": subject.name if subject else "", "method": method.name,
                                "rows": rows}, indent=1) + "\n", encoding="utf-8")  # fmt: skip
    return path


def case_metrics(picture: np.ndarray, truth: np.ndarray, coverage: np.ndarray) -> dict[str, float]:
    """The six metrics of `z2p_core.quality.metrics` and ``shadow_kept``, without those that are nan.

    ``shadow_kept`` is the least-squares gain of the picture's alpha on the true alpha where the object covers nothing:
    1 for the same shadow, 0 for none.
    """
    metrics = image_metrics(np.clip(picture, 0, 1), truth, coverage)
    floor = coverage < FLOOR_COVERAGE
    metrics["shadow_kept"] = least_squares_gain(picture[..., 3][floor], truth[..., 3][floor])
    return {name: round(value, 6) for name, value in metrics.items() if not math.isnan(value)}


def contrast_kept(picture: np.ndarray, plain: np.ndarray, truth: np.ndarray, plain_truth: np.ndarray) -> float:
    """Share of the difference between two true pictures that a method's pictures show: 1 all of it, 0 none.

    The gain of (picture - plain) on (truth - plain truth), all straight sRGB RGBA (H, W, 4), composited on white.
    """
    ours = composite(picture, WHITE) - composite(plain, WHITE)
    theirs = composite(truth, WHITE) - composite(plain_truth, WHITE)
    return least_squares_gain(ours, theirs)


def least_squares_gain(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Slope of the least-squares line through the origin of `ours` over `theirs`; nan if `theirs` are all 0."""
    power = float((theirs.astype(np.float64) ** 2).sum())
    return float((ours.astype(np.float64) * theirs).sum()) / power if power > 0 else math.nan


def draw_points(case: Case, side: int) -> np.ndarray:
    """Picture (H, W, 4) float64 of the case's points as dots on white, near ones darker."""
    camera = Camera(side, side, case.scene.elevation)
    return np.dstack([draw_dots(place_in_scene(case.cloud, case.scene), camera), np.ones((side, side))])


def _contrast_kept(cases: Sequence[Case], index: int, drawn: Sequence[MethodImage], truths: Truths) -> dict[str, float]:
    reference = cases[index].reference
    if not reference:
        return {}
    view = cases[index].view
    plain = next(number for number, case in enumerate(cases) if case.level == reference and case.view == view)
    pictures = drawn[index].picture, drawn[plain].picture
    if pictures[0] is None or pictures[1] is None:
        return {}
    kept = contrast_kept(pictures[0], pictures[1], truths[index][0], truths[plain][0])
    return {} if math.isnan(kept) else {"contrast_kept": round(kept, 6)}


def _save(picture: np.ndarray, path: Path) -> None:
    Image.fromarray(bytes_from_unit(picture)).save(path, format="PNG")


def _describe_row(row: dict[str, Any]) -> str:
    formats = {"psnr_foreground": "object {:.1f} dB", "ssim": "SSIM {:.3f}", "contrast_kept": "kept {:.2f}"}
    parts = [form.format(row[name]) for name, form in formats.items() if name in row]
    return ", ".join(parts) or row.get("error", "rendered")
