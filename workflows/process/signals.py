"""Makes Ctrl-C and SIGTERM end a pipeline together with its tasks, each with one line instead of a traceback.

Without this SIGTERM would end luigi alone, while its tasks, for example hours of training, continued.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType

from z2p_renderer.workflows.process.task_log import log_line

INTERRUPTED = 128 + signal.SIGINT
"""Exit status of an interrupted task."""
TOGETHER_SECONDS = 5.0
"""Signals that come this soon after another are the same wish to stop."""

_interrupted_at = -TOGETHER_SECONDS
"""When this process was last interrupted, by `time.monotonic`."""


def handle_termination() -> None:
    """Treat SIGTERM as Ctrl-C from now on, in this process and those that it forks; existing handlers are kept.

    luigi then interrupts its tasks, which stop Blender and keep their finished files.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    if signal.getsignal(signal.SIGTERM) == signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _interrupt)
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = _print_interruption


@contextmanager
def exit_on_interrupt(name: str) -> Iterator[None]:
    """End a task's process at once on an interrupt, with one line that names the task instead of a traceback."""
    if multiprocessing.parent_process() is not None and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    except KeyboardInterrupt:
        log_line(f"{name}: interrupted")
        if multiprocessing.parent_process() is None:
            raise
        os._exit(INTERRUPTED)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise one KeyboardInterrupt, although a task hears of one Ctrl-C twice: by the terminal, then by luigi."""
    global _interrupted_at
    now, before = time.monotonic(), _interrupted_at
    if now - before >= TOGETHER_SECONDS:
        _interrupted_at = now
        raise KeyboardInterrupt


def _print_interruption(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        log_line("interrupted; what is finished is kept, and the same command goes on from there")
    else:
        sys.__excepthook__(kind, error, trace)
