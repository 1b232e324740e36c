"""Makes Ctrl-C and SIGTERM end a pipeline together with its tasks, each with one line instead of a traceback.

Without this SIGTERM would end luigi alone, while its tasks, for example hours of training, continued.
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
"""Exit status of an interrupted task."""


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
