"""Imports slow libraries when a file needs them, in one thread at a time."""

from __future__ import annotations

from importlib import import_module
from threading import Lock
from types import ModuleType

_one_at_a_time = Lock()


def import_lazily(name: str) -> ModuleType:
    """The module of that name.

    Files are read in threads. Where two of them enter a library whose modules import each other by different doors,
    Python breaks the tie by handing one of them a module that is half made.
    """
    with _one_at_a_time:
        return import_module(name)
