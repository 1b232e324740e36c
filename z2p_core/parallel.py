"""Shares work between the calling thread and one more core, for kernels that release the interpreter's lock.

Besides the calling threads, a process has one worker thread, the *second core*, which runs one piece of work at a time;
`_Core.idle` is held by whoever uses it. Work gets there in two ways:

- `run_async` hands it one whole piece of work, or runs that at once if the worker is busy;
- `parallel_rows`, `begin_parallel_rows` and `parallel_map` cut work into parts. The caller and the worker each take the
  next part that is left, the worker as soon as it is idle, so that a caller never blocks on a worker held by another.

Within `without_second_core` the worker is not used: several images are drawn at a time, one on each core.

The worker is a daemon thread of our own rather than an executor's: executors refuse work once the main thread has ended,
while other threads still draw. If no thread can be started, because the interpreter is shutting down or the system has
none left, the caller does all the work, with the same result.
"""

from __future__ import annotations

import atexit
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from functools import lru_cache, partial
from itertools import pairwise
from queue import SimpleQueue
from threading import Lock, Semaphore, Thread
from typing import Any, TypeVar

T = TypeVar("T")

MIN_PARALLEL_ROWS = 1000
"""Number of rows below which a second thread costs more than it saves."""
PART_COUNT = 6
"""Parts that rows are divided into."""


def core_count() -> int:
    """Number of cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_async(work: Callable[..., Any], *arguments: Any) -> Future[Any]:
    """Future result of ``work(*arguments)`` on the second core; computed at once, here, if that core is busy."""
    core = _second_core(os.getpid())
    if not core.kept_away and core.idle.acquire(blocking=False):
        begun = core.begin(core.run, work, *arguments)
        if begun is not None:
            return begun
        core.idle.release()
    done: Future[Any] = Future()
    _settle(done, work, *arguments)  # errors surface at .result(), as the worker's do
    return done


@contextmanager
def without_second_core() -> Iterator[None]:
    """Context in which all work runs on the calling thread: for callers that keep every core busy with its own image."""
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


def parallel_rows(
    work: Callable[[int, int], object], count: int, smallest: int = MIN_PARALLEL_ROWS, parts: int = PART_COUNT
) -> None:
    """Calls ``work(begin, end)`` for parts of the rows from 0 to `count`, on the second core as well once it is idle.

    In one call, on this thread alone, for fewer rows than `smallest`.
    """
    if count < smallest or _second_core(os.getpid()).kept_away:
        work(0, count)
        return
    begin_parallel_rows(work, count, parts)()


def parallel_map(works: Sequence[Callable[[], T]]) -> list[T]:
    """Results of the given functions, in their order; the second core runs some of them once it is idle."""
    given: list[Any] = [None] * len(works)

    def do(begin: int, end: int) -> None:
        for i in range(begin, end):
            given[i] = works[i]()

    parallel_rows(do, len(works), smallest=2, parts=len(works))
    return given


def begin_parallel_rows(work: Callable[[int, int], object], count: int, parts: int = PART_COUNT) -> Callable[[], None]:
    """Lets the second core begin ``work(begin, end)`` for rows from 0 to `count` as soon as it is idle.

    Returns a function that finishes the rest together with that core.
    """
    go_on, core = _in_parts(work, count, parts), _second_core(os.getpid())
    return partial(_finished, go_on, None if core.kept_away else core.begin(core.help, go_on))


def run_in_threads(works: Sequence[Callable[[], T]]) -> list[T]:
    """Results of the given functions, in their order, each run in its own thread as far as threads can be started."""
    given: list[Future[T]] = [Future() for _ in works]
    threads = []
    for future, work in zip(given[1:], works[1:], strict=True):
        thread = Thread(target=_settle, args=(future, work), name="z2p-part", daemon=True)
        if _started(thread):
            threads.append(thread)
        else:
            _settle(future, work)
    if works:
        _settle(given[0], works[0])
    for thread in threads:
        thread.join()
    return [future.result() for future in given]


def _in_parts(work: Callable[[int, int], object], count: int, parts: int) -> Callable[[], None]:
    """Does the work part by part; whoever else calls it meanwhile takes the next one."""
    left = iter(list(pairwise(count * part // parts for part in range(parts + 1))))

    def go_on() -> None:
        for begin, end in left:
            work(begin, end)

    return go_on


def _finished(go_on: Callable[[], None], second: Future[Any] | None) -> None:
    """Goes on beside a second core to the end; an error is told when nobody works on the rows any more."""
    try:
        go_on()
    finally:
        failed = None if second is None or second.cancel() else second.exception()
    if failed is not None:
        raise failed


class _Core:
    """A thread, and whether it waits for work: those who draw several pictures at a time share it."""

    def __init__(self) -> None:
        self.idle = Semaphore(1)
        self.counting = Lock()
        self.kept_away = 0
        """How many of those who keep all cores busy do so now."""
        self._tasks: SimpleQueue[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = SimpleQueue()
        self._thread: Thread | None = None
        self._process = os.getpid()

    def begin(self, work: Callable[..., Any], *arguments: Any) -> Future[Any] | None:
        """What the work will give, which the thread does when its turn comes; None where no thread can be started."""
        with self.counting:
            if self._thread is None:
                thread = Thread(target=self._serve, name="z2p", daemon=True)
                if not _started(thread):
                    return None
                self._thread = thread
                atexit.register(self._leave)
        future: Future[Any] = Future()
        self._tasks.put((future, work, arguments))
        return future

    def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """What the work gives; by the time it is there, the thread counts as idle."""
        try:
            return work(*arguments)
        finally:
            self.idle.release()

    def help(self, work: Callable[[], None]) -> None:
        """Does the work, when its turn comes, unless others have the thread by then."""
        if self.idle.acquire(blocking=False):
            self.run(work)

    def _serve(self) -> None:
        while True:
            future, work, arguments = self._tasks.get()
            if future.set_running_or_notify_cancel():
                _settle(future, work, *arguments)
            del future, work, arguments  # what waits for work keeps nobody's arrays

    def _leave(self) -> None:
        """Keeps work away for good and waits for what is being done: the thread must be idle when Python goes."""
        if self._process == os.getpid():  # a fork has the object without its thread
            with self.counting:
                self.kept_away += 1
            last: Future[Any] = Future()
            self._tasks.put((last, int, ()))
            last.result()


def _settle(future: Future[Any], work: Callable[..., Any], *arguments: Any) -> None:
    """Gives the future what the work gives, or its error."""
    try:
        future.set_result(work(*arguments))
    except BaseException as error:
        future.set_exception(error)
    finally:
        del future, work, arguments  # an error keeps this frame, which would keep the error


def _started(thread: Thread) -> bool:
    try:
        thread.start()
    except RuntimeError:  # of an interpreter that ends, or of a system that has no more threads
        return False
    return True


@lru_cache(maxsize=1)
def _second_core(process: int) -> _Core:
    """One for each process: a fork would inherit the object without its thread."""
    return _Core()
