"""The report's first paragraph, made of the numbers: who wins the plain case, and where a baseline is ahead."""

from __future__ import annotations

from collections.abc import Sequence

from z2p_renderer.pipeline.evaluation.paper.methods import BASELINE, WEIGHTS
from z2p_renderer.pipeline.evaluation.paper.page.captions import SWEEP_CAPTIONS
from z2p_renderer.pipeline.evaluation.paper.page.results import METRICS, CONTRAST_KEPT, Comparison, Results, compare_best, mean


def summarize(findings: Results, sweeps: Sequence[str]) -> str:
    """Sentences; where a baseline wins, they come first."""
    plain = compare_best(findings, "base")
    if not plain:
        return "There is nothing to compare: weights and baselines are needed, and one of them is missing here."
    lost, won = [duel for duel in plain if duel.lost], [duel for duel in plain if not duel.lost]
    said = []
    if lost:
        said.append("In the plain case a baseline wins: " + "; ".join(map(_describe_comparison, lost)) + ".")
    if won:
        said.append(("In the other figures" if lost else "In the plain case") + " z2p wins: "
                    + "; ".join(map(_describe_comparison, won)) + ".")  # fmt: skip
    others = {sweep: compare_best(findings, sweep) for sweep in sweeps if sweep != "base"}
    every = [duel for found in others.values() for duel in found]
    if every:
        behind = [duel for duel in every if duel.lost]
        said.append(f"Over the other sweeps a baseline is ahead in {len(behind)} of {len(every)} comparisons (sweep, "
                    f"level, figure){_describe_losses(others)}.")  # fmt: skip
    return " ".join(said + _describe_limits(findings))


def _describe_comparison(duel: Comparison) -> str:
    title, form, _ = METRICS[duel.figure]
    ours, theirs = f"{duel.ours} {form.format(duel.our_value)}", f"{duel.theirs} {form.format(duel.their_value)}"
    return f"{title}, {theirs} against {ours}" if duel.lost else f"{title}, {ours} against {theirs}"


def _describe_losses(others: dict[str, list[Comparison]]) -> str:
    parts = [f"{SWEEP_CAPTIONS[sweep].title.lower()} {sum(duel.lost for duel in found)} of {len(found)}"
             for sweep, found in others.items() if any(duel.lost for duel in found)]  # fmt: skip
    return f": {', '.join(parts)}" if parts else ""


def _describe_limits(findings: Results) -> list[str]:
    """Sentences on the limits."""
    said = []
    for sweep in ("bumps", "gap"):
        nearest = {}
        for kind in (WEIGHTS, BASELINE):
            means = {name: mean([abs(1 - kept) for kept in findings.values(sweep, name, CONTRAST_KEPT)])
                   for name in findings.named(kind)}  # fmt: skip
            known = {name: value for name, value in means.items() if value is not None}
            if known:
                name = min(known, key=lambda one: known[one])
                nearest[kind] = name, known[name]
        if len(nearest) == 2:
            (ours, our_value), (theirs, their_value) = nearest[WEIGHTS], nearest[BASELINE]
            side = "nearer to" if their_value < our_value else "farther from"
            title = SWEEP_CAPTIONS[sweep].title.removeprefix("Limit: ").capitalize()
            off = f"off by {their_value:.0%} on average"
            said.append(f"{title}: the contrast of {theirs} is {side} the truth's ({off}) than that of {ours} "
                        f"({our_value:.0%}).")  # fmt: skip
    return said
