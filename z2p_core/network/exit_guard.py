"""Keeps daemon threads out of engines' C++ code while Python ends.

CPython ends a daemon thread at the moment when it wants the interpreter's lock back. In C++ code that promises not to
throw, as the bindings of engines do, that aborts the whole process. So at exit the threads that are inside an engine
are waited for, and later ones are held before it.
"""

from __future__ import annotations

import atexit
import threading
from collections.abc import Iterator
from contextlib import contextmanager

MAX_WAIT_SECONDS = 20.0
"""Longest time that the end of Python waits for a network's run."""

_changed = threading.Condition()
_running: set[int] = set()
_is_ending = threading.Event()


@contextmanager
def inside_engine() -> Iterator[None]:
    """Runs its body, an engine's call, unless Python is ending and this is not the main thread: then it never does."""
    thread = threading.get_ident()
    with _changed:
        blocked = _is_ending.is_set() and threading.current_thread() is not threading.main_thread()
        if not blocked:
            _running.add(thread)
    if blocked:
        threading.Event().wait()
    try:
        yield
    finally:
        with _changed:
            _running.discard(thread)
            _changed.notify_all()


def _wait_for_engines() -> None:
    """Waits until no other thread is inside an engine."""
    own = threading.get_ident()
    with _changed:
        _is_ending.set()
        _changed.wait_for(lambda: not _running - {own}, MAX_WAIT_SECONDS)


atexit.register(_wait_for_engines)
