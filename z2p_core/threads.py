"""The cores at hand, and a second one for the kernels, which hold no lock."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from threading import Semaphore
from typing import Any

import numpy as np

SMALLEST = 1000
"""Rows below which a second thread costs more than it saves."""


def cores() -> int:
    """How many this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def beside(work: Callable[..., Any], *arguments: Any) -> Future[Any]:
    """What the work gives, done on a second core meanwhile; or at once, where that core is still at other work."""
    second = _second_core(os.getpid())
    if second.idle.acquire(blocking=False):
        return second.thread.submit(second.run, work, *arguments)
    done: Future[Any] = Future()
    try:
        done.set_result(work(*arguments))
    except BaseException as error:  # told where the result is asked for, as the other core's would be
        done.set_exception(error)
    return done


@contextmanager
def one_core_each() -> Iterator[None]:
    """Meanwhile `beside` does work at once: for those who keep all cores busy anyway, with a picture on each."""
    idle = _second_core(os.getpid()).idle
    taken = idle.acquire(blocking=False)
    try:
        yield
    finally:
        if taken:
            idle.release()


def in_halves(work: Callable[..., tuple[np.ndarray, ...]], *arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    """What the work gives for rows of the arrays, half of them done on each of two cores, joined again."""
    count = len(arrays[0])
    if count < SMALLEST:
        return work(*arrays)
    second = beside(work, *(array[count // 2 :] for array in arrays))
    first = work(*(array[: count // 2] for array in arrays))
    return tuple(np.concatenate(pair) for pair in zip(first, second.result(), strict=True))


def over_rows(work: Callable[[int, int], object], count: int) -> None:
    """Does the work for rows from 0 up to `count`, half of them on each of two cores."""
    if count < SMALLEST:
        work(0, count)
        return
    second = beside(work, count // 2, count)
    work(0, count // 2)
    second.result()


class _Core:
    """A thread, and whether it waits for work: those who draw several pictures at a time share it."""

    def __init__(self) -> None:
        self.thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="z2p")
        self.idle = Semaphore(1)

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
