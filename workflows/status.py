"""What is fresh, stale or missing, and why: a store compared with a plan. Nothing is written."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from z2p_renderer.storage.results.adoption import VIEW_RANGE
from z2p_renderer.storage.results.differences import compare_fields
from z2p_renderer.storage.results.fingerprints import STAGE_VERSIONS
from z2p_renderer.storage.results.manifests import MANIFEST
from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.plan import AnyPlan, Step

FRESH, STALE, MISSING = "fresh", "stale", "missing"
UPSTREAM_PREFIX, MAX_UPSTREAM_REASONS = "upstream ", 4
"""How a reason begins that lies upstream, and how many of these a table shows."""


@dataclass(frozen=True)
class StepStatus:
    """One step of a plan as it stands in a store."""

    step: str
    stage: str
    state: str
    """``fresh``: its result is there. ``stale``: there is one of other inputs or a damaged one. ``missing``: none."""
    reasons: tuple[str, ...]
    fingerprint: str


def step_statuses(plan: AnyPlan, store: Store) -> list[StepStatus]:
    """State of every step, upstream first. Those that are not fresh are what a run would make, no more and no less."""
    earlier = _PreviousResults(store)
    faults = {step.name: store.faults(step.entry) for step in plan.steps.values()}
    found: list[StepStatus] = []
    for step in plan.steps.values():
        entry = step.entry
        if not faults[step.name]:
            state, reasons = FRESH, []
        elif os.path.lexists(store.folder(entry)):
            state, reasons = STALE, [f"damaged: {faults[step.name][0]}"]
        else:
            before = earlier.like(step)
            state = STALE if before else MISSING
            reasons = _reasons(before, step, plan, earlier) if before else ["never made, or deleted"]
        found.append(StepStatus(step.name, entry.stage, state, tuple(reasons), entry.fingerprint))
    return found


def steps_to_run(found: Sequence[StepStatus]) -> list[StepStatus]:
    """The steps that a run would make."""
    return [one for one in found if one.state != FRESH]


def format_table(found: Sequence[StepStatus], *, every: bool = True) -> list[str]:
    """Lines of a table: state, step and reasons; and a closing line of counts."""
    shown = [one for one in found if every or one.state != FRESH]
    width = max((len(one.step) for one in shown), default=0)
    lines = [f"{one.state.upper():8}{one.step:{width}}  {'; '.join(_shorten_reasons(one.reasons))}".rstrip() for one in shown]
    counts = {state: sum(one.state == state for one in found) for state in (FRESH, STALE, MISSING)}
    return [*lines, ", ".join(f"{count} {state}" for state, count in counts.items())]


def _shorten_reasons(reasons: Sequence[str]) -> list[str]:
    """The reasons, of many that lie upstream only the first."""
    upstream = [reason for reason in reasons if reason.startswith(UPSTREAM_PREFIX)]
    left_out = upstream[MAX_UPSTREAM_REASONS:]
    kept = [reason for reason in reasons if reason not in left_out]
    return [*kept, f"and {len(left_out)} more upstream (--json has all)"] if left_out else kept


def statuses_to_json(found: Sequence[StepStatus]) -> str:
    """The states as a JSON list."""
    return json.dumps([asdict(one) for one in found], indent=1)


def _reasons(before: Mapping[str, Any], step: Step, plan: AnyPlan, earlier: _PreviousResults) -> list[str]:
    """Why the step's result of before does not do, the causes upstream by name."""
    found = compare_fields(_shared(before["fields"]), _shared(step.entry.fields))
    if not found:
        other = before["fields"] != dict(step.entry.fields)
        return ["views are cut into other chunks" if other else "damaged, and put aside in .quarantine"]
    own = [str(one) for one in found if not one.upstream]
    if len(own) == len(found):
        return own
    known = json.dumps(before["fields"])
    changed = [_drop_view_range(name) for name in step.upstream if earlier.is_new(plan.steps[name], known)]
    return own + [f"{UPSTREAM_PREFIX}{name}" for name in dict.fromkeys(changed)] or ["upstream results were taken away"]


def _drop_view_range(name: str) -> str:
    return name.rpartition("/")[0] if name.startswith("render/") else name


class _PreviousResults:
    """Results in the store, by what they are called."""

    def __init__(self, store: Store) -> None:
        found = [pair for stage in STAGE_VERSIONS for pair in store.iter_all_manifests(stage)]
        found.sort(key=lambda pair: (str(pair[1].get("written")), (pair[0] / MANIFEST).stat().st_mtime_ns))
        self._newest = {str(manifest.get("name")): manifest for _, manifest in found}

    def like(self, step: Step) -> dict[str, Any] | None:
        """Manifest of the newest result of the step's name; of a render, however its views were cut into chunks."""
        if step.name in self._newest or step.entry.stage != "render":
            return self._newest.get(step.name)
        mesh = _drop_view_range(step.name)
        others = [one for name, one in self._newest.items() if _drop_view_range(name) == mesh]
        return max(others, key=lambda one: str(one.get("written")), default=None)

    def is_new(self, step: Step, known: str) -> bool:
        """Whether a result with those fields, as JSON, was made of another result than the step's."""
        before = self.like(step)
        if step.entry.stage in ("render", "shapes"):  # what follows knows them by their meshes, not by a fingerprint
            return before is None or bool(compare_fields(_shared(before["fields"]), _shared(step.entry.fields)))
        return step.entry.fingerprint not in known


def _shared(fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields that all chunks of a mesh's renders share."""
    return {key: value for key, value in fields.items() if key not in VIEW_RANGE}
