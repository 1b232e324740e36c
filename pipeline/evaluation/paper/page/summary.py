"""The report's first paragraph, made of the numbers: who wins the plain case, and where a baseline is ahead."""

from __future__ import annotations

from collections.abc import Sequence

from z2p_renderer.pipeline.evaluation.paper.methods import BASELINE, WEIGHTS
from z2p_renderer.pipeline.evaluation.paper.page.captions import KINDS
from z2p_renderer.pipeline.evaluation.paper.page.results import FIGURES, KEPT, Duel, Findings, duels, mean


def lead(findings: Findings, sweeps: Sequence[str]) -> str:
    """Sentences; where a baseline wins, they come first."""
    plain = duels(findings, "base")
    if not plain:
        return "There is nothing to compare: weights and baselines are needed, and one of them is missing here."
    lost, won = [duel for duel in plain if duel.lost], [duel for duel in plain if not duel.lost]
    said = []
    if lost:
        said.append("In the plain case a baseline wins: " + "; ".join(map(_told, lost)) + ".")
    if won:
        said.append(("In the other figures" if lost else "In the plain case") + " z2p wins: "
                    + "; ".join(map(_told, won)) + ".")  # fmt: skip
    others = {sweep: duels(findings, sweep) for sweep in sweeps if sweep != "base"}
    every = [duel for found in others.values() for duel in found]
    if every:
        behind = [duel for duel in every if duel.lost]
        said.append(f"Over the other sweeps a baseline is ahead in {len(behind)} of {len(every)} comparisons (sweep, "
                    f"level, figure){_where(others)}.")  # fmt: skip
    return " ".join(said + _kept(findings))


def _told(duel: Duel) -> str:
    title, form, _ = FIGURES[duel.figure]
    ours, theirs = f"{duel.ours} {form.format(duel.our_value)}", f"{duel.theirs} {form.format(duel.their_value)}"
    return f"{title}, {theirs} against {ours}" if duel.lost else f"{title}, {ours} against {theirs}"


def _where(others: dict[str, list[Duel]]) -> str:
    parts = [f"{KINDS[sweep].title.lower()} {sum(duel.lost for duel in found)} of {len(found)}"
             for sweep, found in others.items() if any(duel.lost for duel in found)]  # fmt: skip
    return f": {', '.join(parts)}" if parts else ""


def _kept(findings: Findings) -> list[str]:
    """Sentences on the limits."""
    said = []
    for sweep in ("bumps", "gap"):
        nearest = {}
        for kind in (WEIGHTS, BASELINE):
            means = {name: mean([abs(1 - kept) for kept in findings.values(sweep, name, KEPT)])
                   for name in findings.named(kind)}  # fmt: skip
            known = {name: value for name, value in means.items() if value is not None}
            if known:
                name = min(known, key=lambda one: known[one])
                nearest[kind] = name, known[name]
        if len(nearest) == 2:
            (ours, our_value), (theirs, their_value) = nearest[WEIGHTS], nearest[BASELINE]
            side = "nearer to" if their_value < our_value else "farther from"
            title = KINDS[sweep].title.removeprefix("Limit: ").capitalize()
            off = f"off by {their_value:.0%} on average"
            said.append(f"{title}: the contrast of {theirs} is {side} the truth's ({off}) than that of {ours} "
                        f"({our_value:.0%}).")  # fmt: skip
    return said
