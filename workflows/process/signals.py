"""Ctrl-C and SIGTERM end a pipeline with all that it has started, in a line each.

Of itself luigi dies of SIGTERM, and its tasks, hours of training say, go on without it.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType

from z2p_renderer.workflows.process.task_log import log_line

INTERRUPTED = 128 + signal.SIGINT
"""Exit status."""


def handle_termination() -> None:
    """Takes SIGTERM for Ctrl-C from now on, in this process and those that it forks; handlers of others stay.

    luigi then sends it on to its tasks, which stop Blender and keep what they have.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    if signal.getsignal(signal.SIGTERM) == signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _interrupt)
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = _print_interruption


@contextmanager
def exit_on_interrupt(name: str) -> Iterator[None]:
    """What a task's process does: an interrupt ends it at once, told by the task's name and not by a traceback."""
    try:
        yield
    except KeyboardInterrupt:
        log_line(f"{name}: interrupted")
        if multiprocessing.parent_process() is None:
            raise
        os._exit(INTERRUPTED)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _print_interruption(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        log_line("interrupted; what is finished is kept, and the same command goes on from there")
    else:
        sys.__excepthook__(kind, error, trace)
