"""What an engine makes once for each size of picture."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from functools import lru_cache
from typing import TypeVar

Size = TypeVar("Size", bound=Hashable)
Made = TypeVar("Made")

MAX_CACHED_SIZES = 4
"""Sizes whose networks are kept at a time, the last used ones."""


def cached_per_size(make: Callable[[Size], Made]) -> Callable[[Size], Made]:
    """`make`, but what it has made for a size is kept; threads that ask at a time wait for each other."""
    kept, lock = lru_cache(MAX_CACHED_SIZES)(make), threading.Lock()

    def made(size: Size) -> Made:
        with lock:
            return kept(size)

    return made
