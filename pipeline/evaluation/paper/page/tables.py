"""The report's tables as rows of words: means with spreads, Table 1, Tables 2 and 3, what trust is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from z2p_renderer.pipeline.evaluation.paper.capability_table import CAPABILITIES, QUOTED_METHODS, CapabilityVerdict, assess_capabilities
from z2p_renderer.pipeline.evaluation.paper.methods import BASELINE, WEIGHTS
from z2p_renderer.pipeline.evaluation.paper.page.results import METRICS, Results, best_value, mean, spread

PAPER_NETWORK_TIMES = {
    1: (0.0, 2.60, 0.020, 2.62), 2: (0.010, 5.04, 0.040, 2.54), 3: (0.010, 7.88, 0.060, 2.65),
    4: (0.010, 10.70, 0.080, 2.69), 5: (0.020, 13.28, 0.110, 2.68), 6: (0.020, 17.48, 0.120, 2.93),
}  # fmt: skip
"""Batch -> seconds to project, for the z-buffer, forward (on a GTX 1080 Ti), and an example on average."""
PAPER_RECONSTRUCTION_TIMES = {"poisson": (2.76, 10.63, 10.53, 23.92), "bpa": (2.76, 1.03, 10.06, 13.85)}
"""Baseline -> seconds for normals, reconstruction and render, and in all."""
UNCERTAINTY_COLUMNS = ("rank_correlation", "area", "best_area", "gain")
MIN_GAIN, MIN_GAIN_OVER_FREE_MAP = 0.5, 0.1
"""What a map of doubt needs to earn its place: a share of the best possible gain, and how much more than a free map."""


@dataclass(frozen=True)
class Table:
    """A table of the page; a cell that begins with ``*`` is the best of its column."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def means_table(findings: Results, sweep: str, title: str) -> Table:
    """Each method's mean and standard deviation over all rows of a sweep's first level; the best is marked."""
    level = findings.levels(sweep)[0]
    names = [*findings.named(WEIGHTS), *findings.named(BASELINE)]
    figures = [*METRICS, "alpha_l1", "shadow_l1"]
    found = {name: {figure: findings.values(sweep, name, figure, level) for figure in figures} for name in names}
    first = {figure: best_value(figure, [value for name in names if (value := mean(found[name][figure])) is not None])
             for figure in figures}  # fmt: skip
    rows = [(name, *(values_cell(found[name][figure], first[figure]) for figure in figures),
             str(len(findings.rows(sweep, name, level)))) for name in names]  # fmt: skip
    heads = [METRICS[figure][0] if figure in METRICS else figure.replace("_", " ") for figure in figures]
    return Table(title, ("method", *heads, "rows"), tuple(rows), "Mean ± standard deviation over meshes and views; "
                 "the best mean of a column is marked. More is better for PSNR and SSIM, less for the others.")


def level_table(findings: Results, sweep: str, figure: str, title: str) -> Table:
    """A row a method, a column a level: the mean of one figure, the best of each level marked."""
    levels = [level for level in findings.levels(sweep)
              if any(figure in row for row in findings.every if row["sweep"] == sweep and row["level"] == level)]
    names = [*findings.named(WEIGHTS), *findings.named(BASELINE)]
    first = {}
    for level in levels:
        means = [mean(findings.values(sweep, name, figure, level)) for name in names]
        first[level] = best_value(figure, [value for value in means if value is not None])
    rows = [(name, *(values_cell(findings.values(sweep, name, figure, level), first[level]) for level in levels))
            for name in names]  # fmt: skip
    return Table(title, ("method", *levels), tuple(rows))


def capabilities_table(findings: Results) -> tuple[Table, dict[str, dict[str, CapabilityVerdict]]]:
    """Table 1, and the verdicts by method that it is made of."""
    weights, rivals = findings.named(WEIGHTS), findings.named(BASELINE)
    found = {name: assess_capabilities(findings, name, name in weights) for name in (*weights, *rivals)}
    rows = []
    for ability in CAPABILITIES:
        cells = [_verdict_cell(found[name][ability.key]) for name in (*weights, *rivals)]
        quoted = [f"{_with_ticks(words[ability.key])} (quoted)" for words in QUOTED_METHODS.values()]
        rows.append((f"{ability.title}: {ability.test}", *cells, *quoted))
    note = ("✓ and ✗ of the methods that run here come from the figures beside them; in brackets the paper's word on "
            "the method's family where it differs. Columns marked quoted do not run here: the paper's word alone.")
    return Table("Table 1", ("ability and its test", *weights, *rivals, *QUOTED_METHODS), tuple(rows), note), found


def network_times_table(times: Mapping[str, Any]) -> Table:
    """Table 2: milliseconds by batch, ours and the paper's."""
    rows = []
    for name, told in times["weights"].items():
        for row in told["rows"]:
            rows.append((name, str(row["batch"]), *(_milliseconds(row[step]) for step in ("project", "zbuffer", "gbuffer",
                                                                               "forward", "each"))))
    for batch, (project, zbuffer, forward, each) in PAPER_NETWORK_TIMES.items():
        rows.append(("the paper", str(batch), _milliseconds(project), _milliseconds(zbuffer), "-", _milliseconds(forward), _milliseconds(each)))
    engines = ", ".join(sorted({told["engine"] for told in times["weights"].values()}))
    return Table("Table 2: milliseconds", ("weights", "batch", "project", "z-buffer", "G-buffer", "forward",
                                           "each example"), tuple(rows),
                 f"Here: {_describe_machine(times)}, engine {engines}. Projecting is part of the z-buffer here and not counted "
                 "twice. The paper: z-buffer in Python, forward on a GTX 1080 Ti.")  # fmt: skip


def reconstruction_times_table(times: Mapping[str, Any]) -> Table:
    """Table 3: seconds by step, of every baseline and of the paper's two."""
    rows: list[tuple[str, ...]] = []
    for name, told in times["baselines"].items():
        if "error" in told:
            rows.append((name, "-", "-", "-", "-", told["error"]))
            continue
        normals = told["steps"].get("normals", told["steps"].get("planes"))
        rest = told["whole"] - (normals or 0.0)
        rest_of = {step: taken for step, taken in told["steps"].items() if step not in ("normals", "planes")}
        others = ", ".join(f"{step} {taken:.2f}" for step, taken in rest_of.items())
        rows.append((name, "-" if normals is None else f"{normals:.2f}", f"{rest:.2f}",
                     f"{told['render']:.2f}" if told["render"] else "-", f"{told['total']:.2f}", others))
    for name, own in PAPER_RECONSTRUCTION_TIMES.items():
        rows.append((f"{name}, the paper", *(f"{seconds:.2f}" for seconds in own), ""))
    return Table("Table 3: seconds", ("baseline", "normals", "reconstruction", "render", "total", "of it"),
                 tuple(rows), f"{_describe_machine(times)}; render is Blender with its start, {times['cycles_samples']} samples.")


def uncertainty_table(told: Sequence[Mapping[str, Any]]) -> tuple[Table, str]:
    """What each map of doubt is worth, and the verdict on disagreement in a sentence."""
    rows, gains = [], {}
    for method in dict.fromkeys(one["method"] for one in told):
        rows_of = [row["maps"] for one in told if one["method"] == method for row in one["rows"]]
        for name in rows_of[0] if rows_of else ():
            held = {key: [row[name][key] for row in rows_of] for key in UNCERTAINTY_COLUMNS}
            gains[method, name] = mean(held["gain"]) or 0.0
            rows.append((method, name, *(values_cell(values) for values in held.values()), str(len(rows_of))))
    head = ("weights", "map", "rank correlation", "area under sparsification", "best area", "share of the best gain",
            "rows")  # fmt: skip
    note = ("On the object. Area: mean error left, over the whole, as the most doubted pixels go; 1 for a "
            "map that knows nothing. Gain: share of the way from 1 to the best area.")
    table = Table("Maps of doubt", head, tuple(rows), note)
    return table, _uncertainty_verdict(gains)


def _uncertainty_verdict(gains: Mapping[tuple[str, str], float]) -> str:
    said = []
    for method in dict.fromkeys(method for method, _ in gains):
        own = gains[method, "disagreement"]
        rival, most = max(((name, gain) for (one, name), gain in gains.items() if one == method and
                           name != "disagreement"), key=lambda pair: pair[1])  # fmt: skip
        earns = own >= MIN_GAIN and own >= most + MIN_GAIN_OVER_FREE_MAP
        said.append(f"{method}: disagreement gains {own:.0%} of what a perfect map would, the best map that costs "
                    f"nothing ({rival}) {most:.0%}: it {'earns' if earns else 'does not earn'} its place (bounds: "
                    f"{MIN_GAIN:.0%}, and {MIN_GAIN_OVER_FREE_MAP:.0%} more than a free map).")  # fmt: skip
    return " ".join(said)


def values_cell(values: Sequence[float], best: float | None = None) -> str:
    """Mean and spread of values in words, ``-`` for none, marked where the mean is the best one."""
    middle, wide = mean(values), spread(values)
    if middle is None:
        return "-"
    told = f"{middle:.2f}" if abs(middle) >= 2 else f"{middle:.3f}"
    told += f" ± {wide:.2g}" if len(values) > 1 else ""
    return f"*{told}" if best is not None and middle == best else told


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
    return (f"{times['points']} points of {times['mesh']} at {width}x{height}, medians of {times['repeats']}, "
            f"{machine['cores']} cores {machine['processor']}, load {machine['load_average'][0]}, "
            f"OMP_NUM_THREADS={machine['omp_num_threads'] or 'unset'}")
