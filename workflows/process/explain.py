"""``--explain`` and ``--dry-run``: what a run would make and why, said before it begins."""

from __future__ import annotations

import logging

import luigi

from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.plan import Planned
from z2p_renderer.workflows.process.task_log import say
from z2p_renderer.workflows.status import states, table, to_run

_explained: set[luigi.Task] = set()


def explain(task: luigi.Task, plan: Planned, store: Store, *, dry_run: bool) -> None:
    """Say, once a task, which steps of its plan would run and why; in a dry run also that nothing was written."""
    if task in _explained:
        return
    _explained.add(task)
    found = states(plan, store)
    say("\n".join(table(found, every=False)))
    if dry_run:
        logging.getLogger("luigi-interface").setLevel(logging.ERROR)  # its summary would call all complete
        say(f"a run would make {len(to_run(found))} of {len(found)} results; nothing was written")
