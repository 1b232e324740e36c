"""``--explain`` and ``--dry-run``: what a run would make and why, said before it begins."""

from __future__ import annotations

import logging

import luigi

from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.plan import AnyPlan
from z2p_renderer.workflows.process.task_log import log_line
from z2p_renderer.workflows.status import format_table, step_statuses, steps_to_run

_explained: set[luigi.Task] = set()


def explain(task: luigi.Task, plan: AnyPlan, store: Store, *, dry_run: bool) -> None:
    """Say, once a task, which steps of its plan would run and why; in a dry run also that nothing was written."""
    if task in _explained:
        return
    _explained.add(task)
    found = step_statuses(plan, store)
    log_line("\n".join(format_table(found, every=False)))
    if dry_run:
        logging.getLogger("luigi-interface").setLevel(logging.ERROR)  # its summary would call all complete
        log_line(f"a run would make {len(steps_to_run(found))} of {len(found)} results; nothing was written")
