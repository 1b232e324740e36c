"""How a long run is doing, in one line every now and then: done, running, images a minute, time left.

Whole lines, so that a log file stays readable. They are written by a thread of the process that a user started.
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
    """Note the pipeline as running and begin to tell how it is doing; once a process, and not in luigi's children."""
    if multiprocessing.parent_process() is not None or (os.getpid(), store.root) in _started:
        return
    _started.add((os.getpid(), store.root))
    registration = Registration(store, plan, source)
    seconds = luigi.configuration.get_config().getfloat("z2p", "progress_seconds", 30.0)
    arguments = (Progress(store, list(plan.steps.values())), registration, seconds)
    threading.Thread(target=_report_until_done, args=arguments, name="progress", daemon=True).start()


@dataclass
class Progress:
    """A plan's progress in a store, from the moment that this is made."""

    store: Store
    steps: Sequence[Step]
    started: float = field(default_factory=time.monotonic)
    first_images: int = field(init=False)

    def __post_init__(self) -> None:
        self.finished: set[str] = set()
        self._look()
        self.first_images = self._images()

    def line(self) -> str:
        """Such as ``progress: 12 of 34 done; running render/bunny/0-10; 41 images a minute; 12 min left to render``."""
        self._look()
        running = [step for step in self.steps if self.store.is_locked(step.entry.stage, step.entry.fingerprint[:32])]
        self.idle = not running
        parts = [f"progress: {len(self.finished)} of {len(self.steps)} done"]
        if running:
            parts.append("running " + ", ".join(self._told(step) for step in running))
        images, asked = self._images(), sum(_view_count(step) for step in self.steps)
        rate = (images - self.first_images) / max(time.monotonic() - self.started, 1e-9) * 60
        if images < asked and rate:
            parts.append(f"{images} of {asked} images, {rate:.1f} a minute, {(asked - images) / rate:.1f} min of "
                         "rendering left")
        return "; ".join(parts)

    def _look(self) -> None:
        for step in self.steps:
            if step.name not in self.finished and self.store.complete(step.entry):
                self.finished.add(step.name)

    def _images(self) -> int:
        """Pictures that are there, those of unfinished chunks too."""
        count = 0
        for step in self.steps:
            if step.name in self.finished:
                count += _view_count(step)
            elif _view_count(step):
                folder = self.store.work_folder(step.entry)
                count += sum(path.name.count(".") == 1 for path in folder.glob("view_*.png"))
        return count

    def _told(self, step: Step) -> str:
        """The step's name, with where it is: the last line that a training has logged says how long it will take."""
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
        except OSError as error:  # a folder that another process renames, or a disk that is away: the note stays alive
            line = f"progress cannot be told ({error})"
        if not progress.idle:  # others may be at a step that this pipeline waits for
            log_line(line)
