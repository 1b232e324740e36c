"""The cores at hand, and a second one for the kernels, which hold no lock."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from itertools import pairwise
from threading import Lock, Semaphore
from typing import Any

SMALLEST = 1000
"""Rows below which a second thread costs more than it saves."""
PARTS = 6
"""Parts that work is shared out in."""


def cores() -> int:
    """How many this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def beside(work: Callable[..., Any], *arguments: Any) -> Future[Any]:
    """What the work gives, done on a second core meanwhile; or at once, where that core is still at other work."""
    begun = _begun(work, *arguments)
    if begun is not None:
        return begun
    done: Future[Any] = Future()
    try:
        done.set_result(work(*arguments))
    except BaseException as error:  # told where the result is asked for, as the other core's would be
        done.set_exception(error)
    return done


@contextmanager
def one_core_each() -> Iterator[None]:
    """Meanwhile work is done at once, in one go: for those who keep all cores busy anyway, with a picture on each."""
    second = _second_core(os.getpid())
    taken = second.idle.acquire(blocking=False)
    with second.counting:
        second.kept_away += 1
    try:
        yield
    finally:
        with second.counting:
            second.kept_away -= 1
        if taken:
            second.idle.release()


def over_rows(work: Callable[[int, int], object], count: int, smallest: int = SMALLEST, parts: int = PARTS) -> None:
    """Does the work for rows from 0 up to `count` in parts, with a second core from the moment on that it is idle."""
    if count < smallest or _second_core(os.getpid()).kept_away:
        work(0, count)
        return
    left = iter(list(pairwise(count * part // parts for part in range(parts + 1))))  # each core takes the next one

    def help_out() -> None:
        for begin, end in left:
            work(begin, end)

    second = None
    try:
        for begin, end in left:
            second = second or _begun(help_out)
            work(begin, end)
    finally:  # an error is told when nobody works on the rows any more
        failed = None if second is None else second.exception()
    if failed is not None:
        raise failed


def _begun(work: Callable[..., Any], *arguments: Any) -> Future[Any] | None:
    """What the work will give on a second core; None, and nothing is done, where that is still at other work."""
    second = _second_core(os.getpid())
    return second.thread.submit(second.run, work, *arguments) if second.idle.acquire(blocking=False) else None


class _Core:
    """A thread, and whether it waits for work: those who draw several pictures at a time share it."""

    def __init__(self) -> None:
        self.thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="z2p")
        self.idle = Semaphore(1)
        self.counting = Lock()
        self.kept_away = 0
        """How many of those who keep all cores busy do so now."""

    def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """What the work gives; by the time it is there, the thread counts as idle."""
        try:
            return work(*arguments)
        finally:
            self.idle.release()


@lru_cache(maxsize=1)
def _second_core(process: int) -> _Core:
    """One for each process: a fork would inherit the object without its thread."""
    return _Core()
