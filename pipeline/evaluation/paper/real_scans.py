"""Draws real scans with every method; their true surface is unknown, so there are pictures and no metrics."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from z2p_core.config.report import ReportConfig
from z2p_core.images import bytes_from_unit, unit_from_bytes
from z2p_renderer.pipeline.evaluation.baselines import load_baselines, run_baseline_on_scenes
from z2p_renderer.pipeline.evaluation.paper.cases.ground_truth import report_render_settings
from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import SYNTHETIC_SETTINGS, VIEW_CONTROLS, Case
from z2p_renderer.pipeline.evaluation.paper.measure import ROWS_FILE, draw_points
from z2p_renderer.pipeline.evaluation.paper.methods import WEIGHTS, Method, cloud_digest, load_renderer
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import place_scan
from z2p_renderer.pipeline.rendering.views import describe, load_controls
from z2p_renderer.storage.meshes import Mesh
from z2p_renderer.storage.models.checkpoints import find_weights
from z2p_renderer.storage.results.fingerprints import file_digest
from z2p_renderer.storage.scans.clouds import format_suffix, read_clouds

MAX_POINTS = 20_000
"""Larger scans are randomly subsampled to so many points, as some baselines would take minutes."""
Log = Callable[[str], None]


def draw_scans(
    method: Method, scans: Sequence[Path], config: ReportConfig, truth_root: Path, out: Path,
    log: Log = lambda line: None,
) -> Path:  # fmt: skip
    """Writes ``out/rows.json``: a row per scan with its picture, or the method's error; ``input_NN.png`` is the cloud.

    Raises:
        ScanError: a file cannot be read.
        WeightsError, PluginError, RenderError: the method cannot be used.
    """
    rows = []
    for index, path in enumerate(scans):
        case = _scan_case(path, config)
        Image.fromarray(bytes_from_unit(draw_points(case, config.resolution))).save(out / f"input_{index:02}.png")
        picture, error = _draw_scan(method, case, path, config, truth_root, log)
        Image.fromarray(bytes_from_unit(picture)).save(out / f"{index:02}.png")
        row: dict[str, Any] = {"level": path.stem, "x": None, "view": 0, "points": len(case.cloud),
                               "picture": f"{index:02}.png"}  # fmt: skip
        rows.append(row | ({"error": error} if error else {}))
        log(f"scan {path.name} {method.name}: {error or 'drawn'}")
    rows_path = out / ROWS_FILE
    rows_path.write_text(
        json.dumps({"sweep": "scans", "mesh": "", "method": method.name, "rows": rows}, indent=1) + "\n"
    )
    return rows_path


def _scan_case(path: Path, config: ReportConfig) -> Case:
    """Case of a scan, placed as `z2p run-inference` does, at 20 degrees of elevation."""
    scan = read_clouds(path)[0]
    placed = place_scan(scan, format_suffix(path), PlacementOptions())
    cloud = placed.cloud
    if len(cloud) > MAX_POINTS:
        rng = np.random.default_rng([config.seed, int(file_digest(path)[:16], 16)])
        cloud = cloud[np.sort(rng.choice(len(cloud), MAX_POINTS, replace=False))]
    scene = describe(load_controls(VIEW_CONTROLS), SYNTHETIC_SETTINGS, np.eye(3))
    scene.floor = float(cloud[:, 2].min())
    return Case(path.stem, 0, cloud, scene, SYNTHETIC_SETTINGS, Mesh(cloud, np.empty((0, 3), np.int64), True))


def _draw_scan(
    method: Method, case: Case, path: Path, config: ReportConfig, root: Path, log: Log
) -> tuple[np.ndarray, str]:
    """Picture (H, W, 4) float32 in [0, 1], and the method's error for a scan that it cannot use, else empty."""
    side = config.resolution
    if method.kind == WEIGHTS:
        renderer = load_renderer(find_weights(method.source))
        values = {name: value for name, value in case.values.items() if name in renderer.controls}
        return unit_from_bytes(renderer.render(case.cloud, values, side, side, case.scene.floor)), ""
    competitor = load_baselines([method.source])[method.source]
    fields = {"sha256": cloud_digest(case.cloud)}  # not the file's digest: placement may change
    rng = np.random.default_rng([config.seed, 5])
    result = run_baseline_on_scenes(
        competitor, case.cloud, fields, rng, [case.scene], report_render_settings(config), root, log
    )[0]
    return result.picture, result.error
