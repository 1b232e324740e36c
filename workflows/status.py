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
from z2p_renderer.workflows.plan import Planned, Step

FRESH, STALE, MISSING = "fresh", "stale", "missing"
UPSTREAM, FEW = "upstream ", 4
"""How a reason begins that lies upstream, and how many of these a table shows."""


@dataclass(frozen=True)
class State:
    """One step of a plan as it stands in a store."""

    step: str
    stage: str
    state: str
    """``fresh``: its result is there. ``stale``: there is one of other inputs or a damaged one. ``missing``: none."""
    reasons: tuple[str, ...]
    fingerprint: str


def states(plan: Planned, store: Store) -> list[State]:
    """State of every step, upstream first. Those that are not fresh are what a run would make, no more and no less."""
    earlier = _Earlier(store)
    faults = {step.name: store.faults(step.entry) for step in plan.steps.values()}
    found: list[State] = []
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
        found.append(State(step.name, entry.stage, state, tuple(reasons), entry.fingerprint))
    return found


def to_run(found: Sequence[State]) -> list[State]:
    """The steps that a run would make."""
    return [one for one in found if one.state != FRESH]


def table(found: Sequence[State], *, every: bool = True) -> list[str]:
    """Lines of a table: state, step and reasons; and a closing line of counts."""
    shown = [one for one in found if every or one.state != FRESH]
    width = max((len(one.step) for one in shown), default=0)
    lines = [f"{one.state.upper():8}{one.step:{width}}  {'; '.join(_few(one.reasons))}".rstrip() for one in shown]
    counts = {state: sum(one.state == state for one in found) for state in (FRESH, STALE, MISSING)}
    return [*lines, ", ".join(f"{count} {state}" for state, count in counts.items())]


def _few(reasons: Sequence[str]) -> list[str]:
    """The reasons, of many that lie upstream only the first."""
    upstream = [reason for reason in reasons if reason.startswith(UPSTREAM)]
    left_out = upstream[FEW:]
    kept = [reason for reason in reasons if reason not in left_out]
    return [*kept, f"and {len(left_out)} more upstream (--json has all)"] if left_out else kept


def as_json(found: Sequence[State]) -> str:
    """The states as a JSON list."""
    return json.dumps([asdict(one) for one in found], indent=1)


def _reasons(before: Mapping[str, Any], step: Step, plan: Planned, earlier: _Earlier) -> list[str]:
    """Why the step's result of before does not do, the causes upstream by name."""
    found = compare_fields(_shared(before["fields"]), _shared(step.entry.fields))
    if not found:
        other = before["fields"] != dict(step.entry.fields)
        return ["views are cut into other chunks" if other else "damaged, and put aside in .quarantine"]
    own = [str(one) for one in found if not one.upstream]
    if len(own) == len(found):
        return own
    known = json.dumps(before["fields"])
    changed = [_without_views(name) for name in step.upstream if earlier.is_new(plan.steps[name], known)]
    return own + [f"{UPSTREAM}{name}" for name in dict.fromkeys(changed)] or ["upstream results were taken away"]


def _without_views(name: str) -> str:
    return name.rpartition("/")[0] if name.startswith("render/") else name


class _Earlier:
    """Results in the store, by what they are called."""

    def __init__(self, store: Store) -> None:
        found = [pair for stage in STAGE_VERSIONS for pair in store.iter_all_manifests(stage)]
        found.sort(key=lambda pair: (str(pair[1].get("written")), (pair[0] / MANIFEST).stat().st_mtime_ns))
        self._newest = {str(manifest.get("name")): manifest for _, manifest in found}

    def like(self, step: Step) -> dict[str, Any] | None:
        """Manifest of the newest result of the step's name; of a render, however its views were cut into chunks."""
        if step.name in self._newest or step.entry.stage != "render":
            return self._newest.get(step.name)
        mesh = _without_views(step.name)
        others = [one for name, one in self._newest.items() if _without_views(name) == mesh]
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
