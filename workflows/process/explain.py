"""``--explain`` and ``--dry-run``: print before a run which steps it makes, and why."""

from __future__ import annotations

import logging

import luigi

from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.plan import AnyPlan
from z2p_renderer.workflows.process.task_log import log_line
from z2p_renderer.workflows.status import format_table, step_statuses, steps_to_run

_explained: set[luigi.Task] = set()


def explain(task: luigi.Task, plan: AnyPlan, store: Store, *, dry_run: bool) -> None:
    """Print, once for each task, which steps of its plan would run and why.

    A dry run also prints their number, and silences luigi, whose summary would call all tasks complete.
    """
    if task in _explained:
        return
    _explained.add(task)
    statuses = step_statuses(plan, store)
    log_line("\n".join(format_table(statuses, with_fresh=False)))
    if dry_run:
        logging.getLogger("luigi-interface").setLevel(logging.ERROR)
        log_line(f"a run would make {len(steps_to_run(statuses))} of {len(statuses)} results; nothing was written")
