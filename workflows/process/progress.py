"""Progress of a long run, printed regularly as one line: steps done and running, images per minute, time left.

A thread of the process that the user started prints whole lines rather than a bar, so that log files stay readable.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import luigi.configuration

from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.plan import AnyPlan, Step
from z2p_renderer.workflows.process.task_log import last_lines, log_line
from z2p_renderer.workflows.upkeep.runs_in_use import Registration

_started: set[tuple[int, Path]] = set()


def start_progress(store: Store, plan: AnyPlan, source: str) -> None:
    """Register the pipeline as running and start printing its progress; once per process, not in luigi's children."""
    if multiprocessing.parent_process() is not None or (os.getpid(), store.root) in _started:
        return
    _started.add((os.getpid(), store.root))
    registration = Registration(store, plan, source)
    seconds = luigi.configuration.get_config().getfloat("z2p", "progress_seconds", 30.0)
    arguments = (Progress(store, list(plan.steps.values())), registration, seconds)
    threading.Thread(target=_report_until_done, args=arguments, name="progress", daemon=True).start()


@dataclass
class Progress:
    """Progress of a plan's steps in a store; rates count from the creation of this object."""

    store: Store
    steps: Sequence[Step]
    started: float = field(default_factory=time.monotonic)
    initial_images: int = field(init=False)

    def __post_init__(self) -> None:
        self.finished: set[str] = set()
        self._update_finished()
        self.initial_images = self._count_images()

    def line(self) -> str:
        """Such as ``progress: 12 of 34 done; running render/bunny/0-10; 41 images a minute; 12 min left to render``."""
        self._update_finished()
        running = [step for step in self.steps if self.store.is_locked(step.entry.stage, step.entry.fingerprint[:32])]
        self.idle = not running
        parts = [f"progress: {len(self.finished)} of {len(self.steps)} done"]
        if running:
            parts.append("running " + ", ".join(self._describe_running(step) for step in running))
        images, total = self._count_images(), sum(_view_count(step) for step in self.steps)
        rate = (images - self.initial_images) / max(time.monotonic() - self.started, 1e-9) * 60
        if images < total and rate:
            parts.append(f"{images} of {total} images, {rate:.1f} a minute, {(total - images) / rate:.1f} min of "
                         "rendering left")
        return "; ".join(parts)

    def _update_finished(self) -> None:
        for step in self.steps:
            if step.name not in self.finished and self.store.complete(step.entry):
                self.finished.add(step.name)

    def _count_images(self) -> int:
        """Number of rendered images, including those of unfinished chunks."""
        count = 0
        for step in self.steps:
            if step.name in self.finished:
                count += _view_count(step)
            elif _view_count(step):
                folder = self.store.work_folder(step.entry)
                count += sum(path.name.count(".") == 1 for path in folder.glob("view_*.png"))
        return count

    def _describe_running(self, step: Step) -> str:
        """The step's name; for training also its last log line, which estimates the time left."""
        if step.entry.stage != "train":
            return step.name
        lines = last_lines(self.store.log(step.entry), 1)
        return f"{step.name} ({lines[0].partition(' ')[2]})" if lines else step.name


def _view_count(step: Step) -> int:
    return step.views[1] - step.views[0]


def _report_until_done(progress: Progress, registration: Registration, seconds: float) -> None:
    while len(progress.finished) < len(progress.steps) and registration.touch():
        time.sleep(seconds)
        try:
            line = progress.line()
        except OSError as error:  # another process renamed a folder, or the disk does not respond: go on with touch()
            line = f"progress cannot be told ({error})"
        if not progress.idle:  # also while this pipeline waits for a step that another one makes
            log_line(line)
