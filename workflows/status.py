"""Compares a store with a plan: which results are fresh, stale or missing, and why. Nothing is written."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from z2p_renderer.storage.results.adoption import VIEW_RANGE
from z2p_renderer.storage.results.differences import compare_fields
from z2p_renderer.storage.results.fingerprints import RENDER_STAGES, STAGE_VERSIONS
from z2p_renderer.storage.results.manifests import MANIFEST
from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.plan import AnyPlan, Step

FRESH, STALE, MISSING = "fresh", "stale", "missing"
UPSTREAM_PREFIX = "upstream "
"""Start of a reason that names an upstream step."""
MAX_UPSTREAM_REASONS = 4
"""Number of upstream reasons that a table shows for a step."""


@dataclass(frozen=True)
class StepStatus:
    """State of one step of a plan in a store."""

    step: str
    stage: str
    state: str
    """``fresh``: the result exists. ``stale``: it is damaged, or made from other inputs. ``missing``: there is none."""
    reasons: tuple[str, ...]
    fingerprint: str


def step_statuses(plan: AnyPlan, store: Store) -> list[StepStatus]:
    """State of every step, upstream first. A run makes exactly the steps that are not fresh."""
    previous_results = _PreviousResults(store)
    faults = {step.name: store.faults(step.entry) for step in plan.steps.values()}
    statuses: list[StepStatus] = []
    for step in plan.steps.values():
        entry = step.entry
        if not faults[step.name]:
            state, reasons = FRESH, []
        elif os.path.lexists(store.folder(entry)):
            state, reasons = STALE, [f"damaged: {faults[step.name][0]}"]
        else:
            state, reasons = MISSING, ["never made, or deleted"]
            if previous := previous_results.newest(step):
                state, reasons = STALE, _staleness_reasons(previous, step, plan, previous_results)
        statuses.append(StepStatus(step.name, entry.stage, state, tuple(reasons), entry.fingerprint))
    return statuses


def steps_to_run(statuses: Sequence[StepStatus]) -> list[StepStatus]:
    """The steps that a run would make."""
    return [status for status in statuses if status.state != FRESH]


def format_table(statuses: Sequence[StepStatus], *, with_fresh: bool = True) -> list[str]:
    """Lines of a table: state, step and reasons of each step, then one line of counts."""
    rows = list(statuses) if with_fresh else steps_to_run(statuses)
    width = max((len(row.step) for row in rows), default=0)
    lines = [
        f"{row.state.upper():8}{row.step:{width}}  {'; '.join(_shorten_reasons(row.reasons))}".rstrip() for row in rows
    ]
    counts = {state: sum(status.state == state for status in statuses) for state in (FRESH, STALE, MISSING)}
    return [*lines, ", ".join(f"{count} {state}" for state, count in counts.items())]


def _shorten_reasons(reasons: Sequence[str]) -> list[str]:
    """All reasons of the step's own, and the first `MAX_UPSTREAM_REASONS` upstream ones."""
    upstream = [reason for reason in reasons if reason.startswith(UPSTREAM_PREFIX)]
    left_out = upstream[MAX_UPSTREAM_REASONS:]
    kept = [reason for reason in reasons if reason not in left_out]
    return [*kept, f"and {len(left_out)} more upstream (--json has all)"] if left_out else kept


def statuses_to_json(statuses: Sequence[StepStatus]) -> str:
    """The states as a JSON list."""
    return json.dumps([asdict(status) for status in statuses], indent=1)


def _staleness_reasons(
    previous: Mapping[str, Any], step: Step, plan: AnyPlan, previous_results: _PreviousResults
) -> list[str]:
    """Why the step's previous result, given by its manifest, is stale. Upstream causes are named by their steps."""
    differences = compare_fields(_without_view_range(previous["fields"]), _without_view_range(step.entry.fields))
    if not differences:
        other_chunks = previous["fields"] != dict(step.entry.fields)
        return ["views are cut into other chunks" if other_chunks else "damaged, and put aside in .quarantine"]
    own = [str(difference) for difference in differences if not difference.upstream]
    if len(own) == len(differences):
        return own
    previous_json = json.dumps(previous["fields"])
    changed = [
        _drop_view_range(name)
        for name in step.upstream
        if previous_results.has_changed(plan.steps[name], previous_json)
    ]
    return own + [f"{UPSTREAM_PREFIX}{name}" for name in dict.fromkeys(changed)] or ["upstream results were taken away"]


def _drop_view_range(name: str) -> str:
    """Name of a step; for ``render/bunny/0-10`` without the last part."""
    return name.rpartition("/")[0] if name.startswith("render/") else name


class _PreviousResults:
    """Manifests of the newest results in a store, by logical name."""

    def __init__(self, store: Store) -> None:
        results = [result for stage in STAGE_VERSIONS for result in store.iter_all_manifests(stage)]
        results.sort(key=lambda result: (str(result[1].get("written")), (result[0] / MANIFEST).stat().st_mtime_ns))
        self._newest = {str(manifest.get("name")): manifest for _, manifest in results}

    def newest(self, step: Step) -> dict[str, Any] | None:
        """Manifest of the newest result with the step's name; for a render also one with another range of views."""
        if step.name in self._newest or step.entry.stage not in RENDER_STAGES:
            return self._newest.get(step.name)
        mesh = _drop_view_range(step.name)
        same_mesh = [manifest for name, manifest in self._newest.items() if _drop_view_range(name) == mesh]
        return max(same_mesh, key=lambda manifest: str(manifest.get("written")), default=None)

    def has_changed(self, step: Step, downstream_json: str) -> bool:
        """Whether a downstream result, given by its fields as JSON, was made from another result than the step's."""
        previous = self.newest(step)
        if step.entry.stage in (*RENDER_STAGES, "shapes"):  # downstream refers to these by mesh, not by fingerprint
            return previous is None or bool(
                compare_fields(_without_view_range(previous["fields"]), _without_view_range(step.entry.fields))
            )
        return step.entry.fingerprint not in downstream_json


def _without_view_range(fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields that all chunks of a mesh's renders share."""
    return {key: value for key, value in fields.items() if key not in VIEW_RANGE}
