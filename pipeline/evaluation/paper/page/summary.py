"""The report's first paragraph, generated from the numbers: the best method of the base sweep, and each sweep in
which a baseline is ahead."""

from __future__ import annotations

from collections.abc import Sequence

from z2p_renderer.pipeline.evaluation.paper.methods import BASELINE, WEIGHTS
from z2p_renderer.pipeline.evaluation.paper.page.captions import SWEEP_CAPTIONS
from z2p_renderer.pipeline.evaluation.paper.page.results import (
    CONTRAST_KEPT,
    METRICS,
    Comparison,
    Results,
    compare_best,
    mean,
)


def summarize(results: Results, sweeps: Sequence[str]) -> str:
    """Summary in sentences; those on metrics that a baseline wins come first."""
    plain = compare_best(results, "base")
    if not plain:
        return "There is nothing to compare: weights and baselines are needed, and one of them is missing here."
    lost, won = [one for one in plain if one.lost], [one for one in plain if not one.lost]
    sentences = []
    if lost:
        sentences.append("In the plain case a baseline wins: " + "; ".join(map(_describe_comparison, lost)) + ".")
    if won:
        sentences.append(("In the other figures" if lost else "In the plain case") + " z2p wins: "
                    + "; ".join(map(_describe_comparison, won)) + ".")  # fmt: skip
    others = {sweep: compare_best(results, sweep) for sweep in sweeps if sweep != "base"}
    every = [comparison for comparisons in others.values() for comparison in comparisons]
    if every:
        behind = [comparison for comparison in every if comparison.lost]
        sentences.append(
            f"Over the other sweeps a baseline is ahead in {len(behind)} of {len(every)} comparisons (sweep, "
            f"level, figure){_describe_losses(others)}."
        )
    return " ".join(sentences + _describe_limits(results))


def _describe_comparison(comparison: Comparison) -> str:
    title, form, _ = METRICS[comparison.metric]
    ours, theirs = (
        f"{comparison.ours} {form.format(comparison.our_value)}",
        f"{comparison.theirs} {form.format(comparison.their_value)}",
    )
    return f"{title}, {theirs} against {ours}" if comparison.lost else f"{title}, {ours} against {theirs}"


def _describe_losses(others: dict[str, list[Comparison]]) -> str:
    lost = {sweep: sum(one.lost for one in comparisons) for sweep, comparisons in others.items()}
    parts = [
        f"{SWEEP_CAPTIONS[sweep].title.lower()} {count} of {len(others[sweep])}"
        for sweep, count in lost.items()
        if count
    ]
    return f": {', '.join(parts)}" if parts else ""


def _describe_limits(results: Results) -> list[str]:
    """Sentences on the sweeps that probe limits."""
    sentences = []
    for sweep in ("bumps", "gap"):
        nearest = {}
        for kind in (WEIGHTS, BASELINE):
            means = {name: mean([abs(1 - kept) for kept in results.values(sweep, name, CONTRAST_KEPT)])
                   for name in results.named(kind)}  # fmt: skip
            known = {name: value for name, value in means.items() if value is not None}
            if known:
                name = min(known, key=lambda one: known[one])
                nearest[kind] = name, known[name]
        if len(nearest) == 2:
            (ours, our_value), (theirs, their_value) = nearest[WEIGHTS], nearest[BASELINE]
            side = "nearer to" if their_value < our_value else "farther from"
            title = SWEEP_CAPTIONS[sweep].title.removeprefix("Limit: ").capitalize()
            off = f"off by {their_value:.0%} on average"
            sentences.append(f"{title}: the contrast of {theirs} is {side} the truth's ({off}) than that of {ours} "
                        f"({our_value:.0%}).")  # fmt: skip
    return sentences
