"""The report's tables as rows of text: means with spreads, Tables 1 to 3 of the paper, scores of uncertainty maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from z2p_renderer.pipeline.evaluation.paper.capability_table import (
    CAPABILITIES,
    QUOTED_METHODS,
    CapabilityVerdict,
    assess_capabilities,
)
from z2p_renderer.pipeline.evaluation.paper.methods import BASELINE, WEIGHTS
from z2p_renderer.pipeline.evaluation.paper.page.results import METRICS, Results, best_value, mean, spread

PAPER_NETWORK_TIMES = {
    1: (0.0, 2.60, 0.020, 2.62), 2: (0.010, 5.04, 0.040, 2.54), 3: (0.010, 7.88, 0.060, 2.65),
    4: (0.010, 10.70, 0.080, 2.69), 5: (0.020, 13.28, 0.110, 2.68), 6: (0.020, 17.48, 0.120, 2.93),
}  # fmt: skip
"""Batch size -> seconds for projection, z-buffer and forward pass (GTX 1080 Ti), and per example."""
PAPER_RECONSTRUCTION_TIMES = {"poisson": (2.76, 10.63, 10.53, 23.92), "bpa": (2.76, 1.03, 10.06, 13.85)}
"""Baseline -> seconds for normals, reconstruction, render, and in total."""
UNCERTAINTY_COLUMNS = ("rank_correlation", "area", "best_area", "gain")
"""Scores of a map in the table, as `uncertainty.score_map` names them."""
MIN_GAIN = 0.5
"""Share of the best possible gain that an uncertainty map needs to be worth its cost."""
MIN_GAIN_OVER_FREE_MAP = 0.1
"""Gain that it needs over the best free map."""


@dataclass(frozen=True)
class Table:
    """A table of the page; a cell that starts with ``*`` is the best of its column."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def means_table(results: Results, sweep: str, title: str) -> Table:
    """Each method's mean and standard deviation over all rows of a sweep's first level; best ones are marked."""
    level = results.levels(sweep)[0]
    names = [*results.named(WEIGHTS), *results.named(BASELINE)]
    metrics = [*METRICS, "alpha_l1", "shadow_l1"]
    values = {name: {metric: results.values(sweep, name, metric, level) for metric in metrics} for name in names}
    best_means = {
        metric: best_value(metric, [value for name in names if (value := mean(values[name][metric])) is not None])
        for metric in metrics
    }
    rows = [(name, *(values_cell(values[name][metric], best_means[metric]) for metric in metrics),
             str(len(results.rows(sweep, name, level)))) for name in names]  # fmt: skip
    heads = [METRICS[metric][0] if metric in METRICS else metric.replace("_", " ") for metric in metrics]
    return Table(
        title,
        ("method", *heads, "rows"),
        tuple(rows),
        "Mean ± standard deviation over meshes and views; "
        "the best mean of a column is marked. More is better for PSNR and SSIM, less for the others.",
    )


def level_table(results: Results, sweep: str, metric: str, title: str) -> Table:
    """Means of one metric: a row per method, a column per level; the best of each level is marked."""
    levels = [
        level
        for level in results.levels(sweep)
        if any(metric in row for row in results.every if row["sweep"] == sweep and row["level"] == level)
    ]
    names = [*results.named(WEIGHTS), *results.named(BASELINE)]
    best_means = {}
    for level in levels:
        means = [mean(results.values(sweep, name, metric, level)) for name in names]
        best_means[level] = best_value(metric, [value for value in means if value is not None])
    rows = [(name, *(values_cell(results.values(sweep, name, metric, level), best_means[level]) for level in levels))
            for name in names]  # fmt: skip
    return Table(title, ("method", *levels), tuple(rows))


def capabilities_table(results: Results) -> tuple[Table, dict[str, dict[str, CapabilityVerdict]]]:
    """Table 1, and its verdicts: method -> capability -> verdict."""
    weights, baselines = results.named(WEIGHTS), results.named(BASELINE)
    verdicts = {name: assess_capabilities(results, name, name in weights) for name in (*weights, *baselines)}
    rows = []
    for capability in CAPABILITIES:
        cells = [_verdict_cell(verdicts[name][capability.key]) for name in (*weights, *baselines)]
        quoted = [f"{_with_ticks(answers[capability.key])} (quoted)" for answers in QUOTED_METHODS.values()]
        rows.append((f"{capability.title}: {capability.test}", *cells, *quoted))
    note = (
        "✓ and ✗ of the methods that run here come from the metrics beside them; in brackets the paper's word on "
        "the method's family where it differs. Columns marked quoted do not run here: the paper's word alone."
    )
    return Table(
        "Table 1", ("ability and its test", *weights, *baselines, *QUOTED_METHODS), tuple(rows), note
    ), verdicts


def network_times_table(times: Mapping[str, Any]) -> Table:
    """Table 2: milliseconds by batch size, ours and the paper's."""
    rows = []
    for name, record in times["weights"].items():
        for row in record["rows"]:
            rows.append(
                (
                    name,
                    str(row["batch"]),
                    *(_milliseconds(row[step]) for step in ("project", "zbuffer", "gbuffer", "forward", "each")),
                )
            )
    for batch, (project, zbuffer, forward, each) in PAPER_NETWORK_TIMES.items():
        rows.append(
            (
                "the paper",
                str(batch),
                _milliseconds(project),
                _milliseconds(zbuffer),
                "-",
                _milliseconds(forward),
                _milliseconds(each),
            )
        )
    engines = ", ".join(sorted({record["engine"] for record in times["weights"].values()}))
    return Table(
        "Table 2: milliseconds",
        ("weights", "batch", "project", "z-buffer", "G-buffer", "forward", "each example"),
        tuple(rows),
        f"Here: {_describe_machine(times)}, engine {engines}. Projecting is part of the z-buffer here and not counted "
        "twice. The paper: z-buffer in Python, forward on a GTX 1080 Ti.",
    )


def reconstruction_times_table(times: Mapping[str, Any]) -> Table:
    """Table 3: seconds by step, of every baseline and of the paper's two."""
    rows: list[tuple[str, ...]] = []
    for name, record in times["baselines"].items():
        if "error" in record:
            rows.append((name, "-", "-", "-", "-", record["error"]))
            continue
        normals = record["steps"].get("normals", record["steps"].get("planes"))
        rest = record["whole"] - (normals or 0.0)
        other_steps = {step: taken for step, taken in record["steps"].items() if step not in ("normals", "planes")}
        others = ", ".join(f"{step} {taken:.2f}" for step, taken in other_steps.items())
        rows.append(
            (
                name,
                "-" if normals is None else f"{normals:.2f}",
                f"{rest:.2f}",
                f"{record['render']:.2f}" if record["render"] else "-",
                f"{record['total']:.2f}",
                others,
            )
        )
    for name, own in PAPER_RECONSTRUCTION_TIMES.items():
        rows.append((f"{name}, the paper", *(f"{seconds:.2f}" for seconds in own), ""))
    return Table(
        "Table 3: seconds",
        ("baseline", "normals", "reconstruction", "render", "total", "of it"),
        tuple(rows),
        f"{_describe_machine(times)}; render is Blender with its start, {times['cycles_samples']} samples.",
    )


def uncertainty_table(records: Sequence[Mapping[str, Any]]) -> tuple[Table, str]:
    """Scores of each uncertainty map, and the verdict on disagreement as sentences."""
    rows, gains = [], {}
    for method in dict.fromkeys(one["method"] for one in records):
        rows_of = [row["maps"] for one in records if one["method"] == method for row in one["rows"]]
        for name in rows_of[0] if rows_of else ():
            scores = {key: [row[name][key] for row in rows_of] for key in UNCERTAINTY_COLUMNS}
            gains[method, name] = mean(scores["gain"]) or 0.0
            rows.append((method, name, *(values_cell(values) for values in scores.values()), str(len(rows_of))))
    head = ("weights", "map", "rank correlation", "area under sparsification", "best area", "share of the best gain",
            "rows")  # fmt: skip
    note = (
        "On the object. Area: mean error left, over the whole, as the most doubted pixels go; 1 for a "
        "map that knows nothing. Gain: share of the way from 1 to the best area."
    )
    table = Table("Maps of doubt", head, tuple(rows), note)
    return table, _uncertainty_verdict(gains)


def _uncertainty_verdict(gains: Mapping[tuple[str, str], float]) -> str:
    sentences = []
    for method in dict.fromkeys(method for method, _ in gains):
        own = gains[method, "disagreement"]
        free_map, most = max(((name, gain) for (one, name), gain in gains.items() if one == method and
                           name != "disagreement"), key=lambda pair: pair[1])  # fmt: skip
        earns = own >= MIN_GAIN and own >= most + MIN_GAIN_OVER_FREE_MAP
        sentences.append(f"{method}: disagreement gains {own:.0%} of what a perfect map would, the best map that costs "
                    f"nothing ({free_map}) {most:.0%}: it {'earns' if earns else 'does not earn'} its place (bounds: "
                    f"{MIN_GAIN:.0%}, and {MIN_GAIN_OVER_FREE_MAP:.0%} more than a free map).")  # fmt: skip
    return " ".join(sentences)


def values_cell(values: Sequence[float], best: float | None = None) -> str:
    """Mean and spread of values as text, ``-`` for none, with a ``*`` if the mean equals `best`."""
    average, deviation = mean(values), spread(values)
    if average is None:
        return "-"
    text = f"{average:.2f}" if abs(average) >= 2 else f"{average:.3f}"
    text += f" ± {deviation:.2g}" if len(values) > 1 else ""
    return f"*{text}" if best is not None and average == best else text


def _verdict_cell(verdict: CapabilityVerdict) -> str:
    word = "not measured" if verdict.passed is None else "✓" if verdict.passed else "✗"
    paper = "" if not verdict.paper or _with_ticks(verdict.paper) == word else f" [paper {_with_ticks(verdict.paper)}]"
    return f"{word} {verdict.why}{paper}" if verdict.passed is not None else f"{word}{paper}"


def _with_ticks(word: str) -> str:
    return word.replace("yes", "✓").replace("no", "✗")


def _milliseconds(seconds: float) -> str:
    return f"{1000 * seconds:.1f}"


def _describe_machine(times: Mapping[str, Any]) -> str:
    machine, (width, height) = times["machine"], times["resolution"]
    return (
        f"{times['points']} points of {times['mesh']} at {width}x{height}, medians of {times['repeats']}, "
        f"{machine['cores']} cores {machine['processor']}, load {machine['load_average'][0]}, "
        f"OMP_NUM_THREADS={machine['omp_num_threads'] or 'unset'}"
    )
