"""Shares work between the calling thread and one more core, for kernels that release the interpreter's lock.

Besides the calling threads, a process has one worker thread, the *second core*, which runs one task at a time; the
caller that uses it holds `_SecondCore.idle`. There are two kinds of tasks:

- `run_async` hands it one whole task, or runs that at once if the worker is busy;
- `parallel_rows`, `begin_parallel_rows` and `parallel_map` divide a task into parts. The caller and the worker each
  take the next part that is left, the worker as soon as it is idle, so a caller never waits for a busy worker.

Within `without_second_core` the worker is not used: several images are rendered at a time, one on each core.

The worker is a daemon thread of this module rather than an executor's: executors refuse work once the main thread has
ended, while other threads may still render. If no thread can be started, because the interpreter is shutting down or
the system has none left, the caller does all the work, with the same result.
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
    if not core.disabled_count and core.idle.acquire(blocking=False):
        pending = core.submit(core.run, work, *arguments)
        if pending is not None:
            return pending
        core.idle.release()
    done: Future[Any] = Future()
    _complete(done, work, *arguments)  # errors are raised by .result(), as the worker's are
    return done


@contextmanager
def without_second_core() -> Iterator[None]:
    """Context in which all work runs on the calling thread: for callers that render an image on each core at a time."""
    core = _second_core(os.getpid())
    acquired = core.idle.acquire(blocking=False)
    with core.lock:
        core.disabled_count += 1
    try:
        yield
    finally:
        with core.lock:
            core.disabled_count -= 1
        if acquired:
            core.idle.release()


def parallel_rows(
    work: Callable[[int, int], object], count: int, smallest: int = MIN_PARALLEL_ROWS, parts: int = PART_COUNT
) -> None:
    """Calls ``work(begin, end)`` for parts of the rows from 0 to `count`, on the second core as well once it is idle.

    Fewer rows than `smallest` are one call on this thread.
    """
    if count < smallest or _second_core(os.getpid()).disabled_count:
        work(0, count)
        return
    begin_parallel_rows(work, count, parts)()


def parallel_map(works: Sequence[Callable[[], T]]) -> list[T]:
    """Results of the given functions, in their order; the second core runs some of them once it is idle."""
    results: list[Any] = [None] * len(works)

    def run_range(begin: int, end: int) -> None:
        for index in range(begin, end):
            results[index] = works[index]()

    parallel_rows(run_range, len(works), smallest=2, parts=len(works))
    return results


def begin_parallel_rows(work: Callable[[int, int], object], count: int, parts: int = PART_COUNT) -> Callable[[], None]:
    """Starts ``work(begin, end)`` for parts of the rows from 0 to `count` on the second core, once that is idle.

    Returns a function that does the remaining parts together with that core, and raises the work's error if it fails.
    """
    run_parts, core = _divide(work, count, parts), _second_core(os.getpid())
    return partial(_finish, run_parts, None if core.disabled_count else core.submit(core.run_if_idle, run_parts))


def run_in_threads(works: Sequence[Callable[[], T]]) -> list[T]:
    """Results of the given functions, in their order, each run in its own thread as far as threads can be started."""
    futures: list[Future[T]] = [Future() for _ in works]
    threads = []
    for future, work in zip(futures[1:], works[1:], strict=True):
        thread = Thread(target=_complete, args=(future, work), name="z2p-part", daemon=True)
        if _try_start(thread):
            threads.append(thread)
        else:
            _complete(future, work)
    if works:
        _complete(futures[0], works[0])
    for thread in threads:
        thread.join()
    return [future.result() for future in futures]


def _divide(work: Callable[[int, int], object], count: int, parts: int) -> Callable[[], None]:
    """A function that does the work part by part; several threads may call it, and each takes the next part."""
    remaining = iter(list(pairwise(count * part // parts for part in range(parts + 1))))

    def run_parts() -> None:
        for begin, end in remaining:
            work(begin, end)

    return run_parts


def _finish(run_parts: Callable[[], None], second: Future[Any] | None) -> None:
    """Does the remaining parts and waits for the second core; its error is raised only when neither thread works."""
    try:
        run_parts()
    finally:
        failed = None if second is None or second.cancel() else second.exception()
    if failed is not None:
        raise failed


class _SecondCore:
    """The worker thread, which all callers of a process share."""

    def __init__(self) -> None:
        self.idle = Semaphore(1)
        """Held by the caller whose task runs, or is the next to run."""
        self.lock = Lock()
        """Guards `disabled_count` and the start of the thread."""
        self.disabled_count = 0
        """Number of callers within `without_second_core`."""
        self._tasks: SimpleQueue[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = SimpleQueue()
        self._thread: Thread | None = None
        self._process = os.getpid()

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any] | None:
        """Future result of ``work(*arguments)``, queued for the thread; None if no thread can be started."""
        with self.lock:
            if self._thread is None:
                thread = Thread(target=self._serve, name="z2p", daemon=True)
                if not _try_start(thread):
                    return None
                self._thread = thread
                atexit.register(self._shut_down)
        future: Future[Any] = Future()
        self._tasks.put((future, work, arguments))
        return future

    def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Result of ``work(*arguments)``; the thread is marked idle before the result is available."""
        try:
            return work(*arguments)
        finally:
            self.idle.release()

    def run_if_idle(self, work: Callable[[], None]) -> None:
        """Does the work, unless another caller holds the thread by then."""
        if self.idle.acquire(blocking=False):
            self.run(work)

    def _serve(self) -> None:
        while True:
            future, work, arguments = self._tasks.get()
            if future.set_running_or_notify_cancel():
                _complete(future, work, *arguments)
            del future, work, arguments  # a waiting thread must not keep the arrays of the last task alive

    def _shut_down(self) -> None:
        """Refuses new tasks and waits for the running one: the thread must be idle when the interpreter exits."""
        if self._process == os.getpid():  # a fork has the object without its thread
            with self.lock:
                self.disabled_count += 1
            last: Future[Any] = Future()
            self._tasks.put((last, int, ()))
            last.result()


def _complete(future: Future[Any], work: Callable[..., Any], *arguments: Any) -> None:
    """Sets the future to the result of ``work(*arguments)``, or to its error."""
    try:
        future.set_result(work(*arguments))
    except BaseException as error:
        future.set_exception(error)
    finally:
        del future, work, arguments  # an error refers to this frame, which would refer to the error in a circle


def _try_start(thread: Thread) -> bool:
    """Starts the thread; False if the system or the interpreter allows no more threads."""
    try:
        thread.start()
    except RuntimeError:  # the interpreter is shutting down, or the system has no more threads
        return False
    return True


@lru_cache(maxsize=1)
def _second_core(process: int) -> _SecondCore:
    """The worker of a process, by its id: a fork inherits the object without its thread, so it needs one of its own."""
    return _SecondCore()
