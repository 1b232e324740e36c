"""A cache of what an engine prepares once for each image size."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from functools import lru_cache
from typing import TypeVar

Size = TypeVar("Size", bound=Hashable)
Prepared = TypeVar("Prepared")

MAX_CACHED_SIZES = 4
"""Sizes that are kept at a time, the most recently used ones."""


def cached_per_size(prepare: Callable[[Size], Prepared]) -> Callable[[Size], Prepared]:
    """`prepare` with a cache of its results; concurrent threads wait for each other, so that each size is made once."""
    cached, lock = lru_cache(MAX_CACHED_SIZES)(prepare), threading.Lock()

    def get(size: Size) -> Prepared:
        with lock:
            return cached(size)

    return get
