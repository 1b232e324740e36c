"""Scores uncertainty maps: does disagreement between pictures of random half clouds predict where a picture errs?"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from z2p_core.camera import Camera
from z2p_core.config.report import ReportConfig
from z2p_core.images import bytes_from_unit, composite
from z2p_renderer.pipeline.evaluation.paper.cases.ground_truth import render_case_truths
from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import Case, TrueMesh, sweep_cases
from z2p_renderer.pipeline.evaluation.paper.measure import WHITE
from z2p_renderer.pipeline.evaluation.paper.methods import Method, draw_case

UNCERTAINTY_FILE = "trust.json"
SUBSAMPLE_SHARE = 0.5
"""Share of the points in each random subset."""
SPARSENESS_RADIUS = 4
"""Radius of the window in which the sparseness map counts points, pixels."""
REMOVED_SHARES = np.arange(0, 1, 0.05)
"""Shares of the pixels that the sparsification curve removes, the most uncertain first."""
DISPLAY_GAIN = 4.0
"""Factor by which maps are brightened for display."""
Log = Callable[[str], None]


def measure_uncertainty(
    subject: TrueMesh, method: Method, config: ReportConfig, truth_root: Path, out: Path, log: Log = lambda line: None
) -> Path:
    """Writes ``out/trust.json``: a row per view with the score of each map; and the maps of the first view.

    Maps: ``disagreement`` (spread over pictures of random half clouds), and two free ones as references: ``edges`` (the
    picture's gradient) and ``sparseness`` (few points near the pixel).

    Raises:
        WeightsError, PluginError: the weights cannot be used.
        RenderError: Blender failed, or a stored render is damaged.
    """
    cases = sweep_cases("base", subject, config)
    truths = render_case_truths(cases, config, truth_root, log)
    rows: list[dict[str, Any]] = []
    for index, (case, (truth, coverage)) in enumerate(zip(cases, truths, strict=True)):
        drawn = draw_case(method, case, config).picture
        if drawn is None:
            continue
        picture = composite(drawn, WHITE)
        error = np.abs(picture - composite(truth, WHITE)).mean(-1)
        maps = {"disagreement": disagreement(method, case, config), "edges": _edge_strength(picture),
                "sparseness": _sparseness(case, config.resolution)}  # fmt: skip
        on_object = coverage > 0  # elsewhere certainty is trivial
        scores = {name: score_map(values[on_object], error[on_object]) for name, values in maps.items()}
        rows.append({"view": case.view, "maps": scores})
        if index == 0:
            for name, drawing in {"picture": picture, "error": DISPLAY_GAIN * error, **{
                "disagreement": DISPLAY_GAIN * maps["disagreement"]}}.items():  # fmt: skip
                Image.fromarray(bytes_from_unit(drawing)).save(out / f"{name}.png")
        log(f"trust {subject.name} {method.name}: rank correlation "
            f"{rows[-1]['maps']['disagreement']['rank_correlation']:.2f}")  # fmt: skip
    path = out / UNCERTAINTY_FILE
    path.write_text(json.dumps({"mesh": subject.name, "method": method.name, "rows": rows}, indent=1) + "\n")
    return path


def disagreement(method: Method, case: Case, config: ReportConfig) -> np.ndarray:
    """Map (H, W) of the standard deviation, on white, between pictures of random half clouds."""
    rng = np.random.default_rng([config.seed, 7])
    pictures = []
    for _ in range(config.trust_draws):
        chosen = rng.choice(len(case.cloud), max(1, int(SUBSAMPLE_SHARE * len(case.cloud))), replace=False)
        drawn = draw_case(method, case, config, case.cloud[np.sort(chosen)]).picture
        if drawn is not None:
            pictures.append(composite(drawn, WHITE))
    spread: np.ndarray = np.std(pictures, axis=0).mean(-1)
    return spread


def score_map(predicted: np.ndarray, error: np.ndarray) -> dict[str, float]:
    """Scores of an uncertainty map `predicted` against the true `error`, both (N,) or (H, W).

    ``rank_correlation`` is Spearman's. ``area`` is that under the sparsification curve: mean error of the remaining
    pixels, relative to all, as the most uncertain ones are removed; 1 for a random map. ``best_area`` is that of the
    error itself. ``gain`` = (1 - area) / (1 - best_area): 1 for a perfect map, 0 for a random one.
    """
    uncertainty, truth = predicted.ravel().astype(np.float64), error.ravel().astype(np.float64)
    area, best = _area_under_sparsification(uncertainty, truth), _area_under_sparsification(truth, truth)
    correlation = (
        float(np.corrcoef(_ranks(uncertainty), _ranks(truth))[0, 1]) if np.ptp(uncertainty) and np.ptp(truth) else 0.0
    )
    gain = (1 - area) / (1 - best) if best < 1 else 0.0
    return {"rank_correlation": round(correlation, 6), "area": round(area, 6), "best_area": round(best, 6),
            "gain": round(gain, 6)}  # fmt: skip


def _area_under_sparsification(uncertainty: np.ndarray, error: np.ndarray) -> float:
    """Mean over `REMOVED_SHARES` of the remaining pixels' error, relative to all."""
    ordered = error[np.argsort(-uncertainty, kind="stable")]
    total = ordered.mean()
    if total == 0:
        return 1.0
    return float(np.mean([ordered[int(step * len(ordered)) :].mean() / total for step in REMOVED_SHARES]))


def _ranks(values: np.ndarray) -> np.ndarray:
    """Ranks (N,) of values (N,); ties share their mean rank."""
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    ranks: np.ndarray = (last - (counts - 1) / 2)[which.reshape(-1)]
    return ranks


def _edge_strength(picture: np.ndarray) -> np.ndarray:
    down, right = np.gradient(picture.mean(-1))
    steepness: np.ndarray = np.hypot(down, right)
    return steepness


def _sparseness(case: Case, side: int) -> np.ndarray:
    """Map (H, W): minus the number of points around each pixel."""
    placed = case.cloud.astype(np.float64) @ np.array(case.scene.rotation).T + (0, 0, case.scene.lift)
    pixels, _ = Camera(side, side, case.scene.elevation).project(placed)
    column, row = np.floor(pixels).astype(int).T
    inside = (column >= 0) & (column < side) & (row >= 0) & (row < side)
    counts = np.zeros((side, side))
    np.add.at(counts, (row[inside], column[inside]), 1)
    for axis in (0, 1):
        counts = np.sum(
            [np.roll(counts, step, axis) for step in range(-SPARSENESS_RADIUS, SPARSENESS_RADIUS + 1)], axis=0
        )
    sparseness: np.ndarray = -counts
    return sparseness
