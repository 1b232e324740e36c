"""The ablations as a Markdown page, and the same numbers as CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from z2p_core import __version__
from z2p_core.config import to_dict
from z2p_core.config.ablation import AblationsConfig
from z2p_core.quality.metrics import METRIC_NAMES
from z2p_renderer.pipeline.evaluation.ablation.curves import draw_curves
from z2p_renderer.pipeline.evaluation.ablation.outcomes import (
    BETTER,
    DECIDING_METRIC,
    NO_DIFFERENCE,
    WORSE,
    Folders,
    MetricDifference,
    VariantResult,
    read_variant_results,
    seed_variation,
)
from z2p_renderer.storage.files.atomic_write import atomic_write

TABLE_HEAD = ("variant", "what it changes", "object dB", "to the base", "white dB", "to the base", "SSIM", "FLIP",
        "weights", "training", "a picture")  # fmt: skip


def write_ablations(config: AblationsConfig, folders: Folders, command: str, out: Path) -> list[Path]:
    """Writes ``ablations.md``, ``.csv`` and ``.json`` and ``curves.png`` to `out`; the page cites `command`.

    Raises:
        OSError: a result is missing.
        WeightsError: weights are damaged.
    """
    outcomes = read_variant_results(config, folders)
    rows = result_rows(outcomes)
    content = {
        "z2p": __version__, "name": config.name, "command": command, "base": to_dict(config.base),
        "deciding": DECIDING_METRIC, "chance_db": seed_variation(outcomes), "variants": rows,
    }  # fmt: skip
    texts = {"ablations.md": ablations_page(config, outcomes, command), "ablations.csv": _as_csv(rows),
             "ablations.json": json.dumps(content, indent=1) + "\n"}  # fmt: skip
    for name, text in texts.items():
        atomic_write(text.encode(), out / name)
    return [*(out / name for name in texts), draw_curves(outcomes, out / "curves.png")]


def result_rows(outcomes: Sequence[VariantResult]) -> list[dict[str, Any]]:
    """One JSON object per variant."""
    chance = seed_variation(outcomes)
    return [
        {
            "name": one.variant.name, "title": one.variant.title, "why": one.variant.why,
            "changes": {key: list(values) for key, values in one.variant.changes.items()},
            "means": dict(one.means),
            "differences": {name: asdict(difference) for name, difference in one.differences.items()},
            "verdict": one.verdict(chance) if one.differences else "", "weights": one.weights, "samples": one.samples,
            "train_seconds": one.seconds, "results": list(one.results),
        }
        for one in outcomes
    ]  # fmt: skip


def ablations_page(config: AblationsConfig, outcomes: Sequence[VariantResult], command: str) -> str:
    """The page in Markdown: how it was made, the table, what may be concluded, the curves, and why each was tried."""
    table = [TABLE_HEAD, ("---",) * len(TABLE_HEAD), *(_table_row(one) for one in outcomes)]
    whys = [f"- **{one.variant.title}** (`{one.variant.name}`): {one.variant.why}" for one in outcomes[1:]]
    return "\n".join([
        f"# Ablations: {config.name}", "", "```sh", command, "```", "", _describe_setting(config, outcomes), "",
        *("| " + " | ".join(row) + " |" for row in table), "", *_conclusions(outcomes), "",
        "![Learning curves of all variants](curves.png)", "", "## Why each was tried", "", *whys, "",
    ])  # fmt: skip


def _describe_setting(config: AblationsConfig, outcomes: Sequence[VariantResult]) -> str:
    train, measure = config.base.train, config.base.evaluate
    return (
        f"Every run sees {outcomes[0].samples:,} samples ({train.steps:,} steps of {train.batch}) of the same renders, "
        f"and is measured on the same views: {measure.views} of each mesh, {measure.points:,} points, "
        f"{measure.resolution} pixels a side. Differences are means over the meshes, ± their standard error. Times are "
        "of the machine as it was, with all else that ran on it; a training that was stopped and went on has none."
    )


def _table_row(one: VariantResult) -> tuple[str, ...]:
    changes = ", ".join(f"`{key}` {_format_value(before)} → {_format_value(after)}" for key, (before, after) in
                        one.variant.changes.items())  # fmt: skip
    return (
        one.variant.title,
        changes or "–",
        _format_number(one.means.get("psnr_foreground"), ".2f"),
        _format_difference(one.differences.get("psnr_foreground")),
        _format_number(one.means.get("psnr_white"), ".2f"),
        _format_difference(one.differences.get("psnr_white")),
        _format_number(one.means.get("ssim"), ".3f"),
        _format_number(one.means.get("flip"), ".3f"),
        f"{one.weights / 1e6:.2f} M",
        _format_number(one.seconds, ".0f", " s"),
        _format_number(1000 * one.means.get("seconds", 0.0) or None, ".0f", " ms"),
    )


def _conclusions(outcomes: Sequence[VariantResult]) -> list[str]:
    """Lines on which variants are better, worse or no different, and how that was decided."""
    chance = seed_variation(outcomes)
    seeds = sum(one.variant.is_repeat for one in outcomes)
    how = "By PSNR on the object. A difference counts that is larger than two standard errors over the meshes"
    if chance is None:
        how += ". No other seed was tried, so what chance does to a training is not known."
    else:
        how += (f" and than what {seeds} other seed{'s' * (seeds > 1)} moved the base by: {chance:.2f} dB, which is a "
                "sample of chance and no bound on it.")  # fmt: skip
    lines = ["## What can be told", "", how, ""]
    judged = [one for one in outcomes[1:] if not one.variant.is_repeat]
    for verdict in (BETTER, WORSE, NO_DIFFERENCE):
        names = [
            f"{one.variant.title} ({_format_difference(one.differences.get(DECIDING_METRIC))} dB)"
            for one in judged
            if one.verdict(chance) == verdict
        ]
        lines.append(f"- {verdict}: {', '.join(names) or 'none'}")
    return lines


def _as_csv(rows: Sequence[dict[str, Any]]) -> str:
    text = io.StringIO()
    errors = [f"{name}_{part}" for name in METRIC_NAMES for part in ("difference", "error")]
    columns = ["name", "title", "changes", *METRIC_NAMES, *errors, "verdict", "weights", "samples", "train_seconds",
               "picture_seconds", "train", "evaluate"]  # fmt: skip
    writer = csv.DictWriter(text, columns, lineterminator="\n", extrasaction="ignore")
    writer.writeheader()
    for row in rows:
        flat = {**row, **row["means"], "picture_seconds": row["means"].get("seconds")}
        flat["changes"] = "; ".join(f"{key}={_format_value(after)}" for key, (_, after) in row["changes"].items())
        flat |= dict(zip(("train", "evaluate"), row["results"], strict=True))
        for name, difference in row["differences"].items():
            flat |= {f"{name}_difference": difference["mean"], f"{name}_error": difference["error"]}
        writer.writerow(flat)
    return text.getvalue()


def _format_difference(difference: MetricDifference | None) -> str:
    if difference is None:
        return "–"
    return f"{difference.mean:+.2f}" + ("" if difference.error is None else f" ± {difference.error:.2f}")


def _format_number(value: float | None, form: str, unit: str = "") -> str:
    return "–" if value is None else f"{value:{form}}{unit}"


def _format_value(value: Any) -> str:
    return "-".join(map(str, value)) if isinstance(value, list) else str(value)
