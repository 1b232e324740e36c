"""The cores at hand, and a second one for the kernels, which hold no lock.

Beside the threads that ask, a process has one more, the *second core*, which does one piece of work at a time; `idle`
of `_Core` is held by whoever has it. Work gets there in two ways:

- `run_async` hands it one piece of work whole, or does that at once where the core is not idle;
- `parallel_rows`, `begin_parallel_rows` and `parallel_map` cut work into parts. Whoever asked and the second core each take the next part
  that is left, the second core from the moment on that it is idle. So nobody waits for a core that others keep.

Within `without_second_core` no work goes there: several pictures are drawn at a time, one on each core.

The second core is a daemon thread of our own and not an executor's: those take no more work once the main thread has
ended, while other threads still draw. Where no thread can be started, because the interpreter ends or the system has
none left, whoever asks does all the work, with the same result.
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
"""Rows below which a second thread costs more than it saves."""
PART_COUNT = 6
"""Parts that work is shared out in."""


def core_count() -> int:
    """How many this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_async(work: Callable[..., Any], *arguments: Any) -> Future[Any]:
    """What the work gives, done on a second core meanwhile; or at once, where that core is still at other work."""
    core = _second_core(os.getpid())
    if not core.kept_away and core.idle.acquire(blocking=False):
        begun = core.begin(core.run, work, *arguments)
        if begun is not None:
            return begun
        core.idle.release()
    done: Future[Any] = Future()
    _settle(done, work, *arguments)  # an error is told where the result is asked for, as the other core's would be
    return done


@contextmanager
def without_second_core() -> Iterator[None]:
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


def parallel_rows(work: Callable[[int, int], object], count: int, smallest: int = MIN_PARALLEL_ROWS, parts: int = PART_COUNT) -> None:
    """Does the work for rows from 0 up to `count` in parts, with a second core from the moment on that it is idle."""
    if count < smallest or _second_core(os.getpid()).kept_away:
        work(0, count)
        return
    begin_parallel_rows(work, count, parts)()


def parallel_map(works: Sequence[Callable[[], T]]) -> list[T]:
    """What each of the works gives, in their order; a second core does some, from the moment on that it is idle."""
    given: list[Any] = [None] * len(works)

    def do(begin: int, end: int) -> None:
        for i in range(begin, end):
            given[i] = works[i]()

    parallel_rows(do, len(works), smallest=2, parts=len(works))
    return given


def begin_parallel_rows(work: Callable[[int, int], object], count: int, parts: int = PART_COUNT) -> Callable[[], None]:
    """Has a second core begin the work for rows from 0 up to `count`, as soon as it is idle.

    What comes back does all that is left, together with that core.
    """
    go_on, core = _in_parts(work, count, parts), _second_core(os.getpid())
    return partial(_finished, go_on, None if core.kept_away else core.begin(core.help, go_on))


def run_in_threads(works: Sequence[Callable[[], T]]) -> list[T]:
    """What each of the works gives, in their order, each in a thread of its own as far as threads can be started."""
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
