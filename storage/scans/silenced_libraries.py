"""Suppresses the warnings and log lines of libraries while they read files, in all reading threads."""

from __future__ import annotations

import logging
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

_LIBRARY_MODULES = r"(z2p_renderer\.plugins\.readers|numpy|PIL|laspy|trimesh|pypcd4|pye57|meshio|h5py)(\.|$)"
"""Modules whose warnings are suppressed. z2p's own RenderWarning is attributed to the caller's module."""
_lock, _reading = threading.Lock(), threading.local()
_active_readers = 0
"""Number of threads inside `quiet`; the first installs the filters, the last removes them."""


class _Silence(logging.Filter):
    """Drops records of threads that are reading; it is attached only to the handler of last resort."""

    def filter(self, record: logging.LogRecord) -> bool:
        return not getattr(_reading, "now", False)


_silence = _Silence()


@contextmanager
def quiet() -> Iterator[None]:
    """Context in which no library's warning reaches the user, and no log line unless logging is configured."""
    _start_silence()
    before, _reading.now = getattr(_reading, "now", False), True
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        _reading.now = before
        _end_silence()


def _start_silence() -> None:
    global _active_readers
    with _lock:
        _active_readers += 1
        if _active_readers == 1:
            warnings.filterwarnings("ignore", module=_LIBRARY_MODULES)
            if logging.lastResort is not None:
                logging.lastResort.addFilter(_silence)


def _end_silence() -> None:
    global _active_readers
    with _lock:
        _active_readers -= 1
        if _active_readers == 0:
            ours = [entry for entry in warnings.filters if getattr(entry[3], "pattern", None) == _LIBRARY_MODULES]
            for entry in ours:
                warnings.filters.remove(entry)  # type: ignore[attr-defined]
            getattr(warnings, "_filters_mutated", lambda: None)()
            if logging.lastResort is not None:
                logging.lastResort.removeFilter(_silence)
