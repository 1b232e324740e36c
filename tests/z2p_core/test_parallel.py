"""The second core: results and errors come back from it, and nobody waits for another's work on it."""

import threading
import time
import weakref

import numpy as np
import pytest

from z2p_core import parallel
from z2p_core.parallel import (
    MIN_PARALLEL_ROWS,
    begin_parallel_rows,
    parallel_map,
    parallel_rows,
    run_async,
    run_in_threads,
    without_second_core,
)


def test_async_work_runs_on_another_thread():
    assert run_async(threading.get_ident).result() != threading.get_ident()
    assert run_async(lambda x, y: x + y, 2, 3).result() == 5


def test_errors_come_back_from_either_thread():
    stop = threading.Event()
    busy = run_async(stop.wait)
    here = run_async(lambda: 1 / 0)
    stop.set()
    busy.result()
    for future in (here, run_async(lambda: 1 / 0)):
        with pytest.raises(ZeroDivisionError):
            future.result()


def test_work_runs_here_while_the_second_core_is_busy():
    stop = threading.Event()
    busy = run_async(stop.wait)
    try:
        assert run_async(threading.get_ident).result(timeout=0) == threading.get_ident()
    finally:
        stop.set()
        busy.result()
    free = run_async(threading.get_ident).result()
    assert free != threading.get_ident(), "and the core is used again afterwards"


@pytest.mark.parametrize("count", [0, 1, MIN_PARALLEL_ROWS - 1, MIN_PARALLEL_ROWS, 2 * MIN_PARALLEL_ROWS + 1])
def test_every_row_is_worked_on_once(count):
    seen = np.zeros(count, int)

    def work(first, last):
        seen[first:last] += 1

    parallel_rows(work, count)
    assert (seen == 1).all()


def test_an_idle_second_core_joins_work_in_progress():
    stop, asking, seen = threading.Event(), threading.get_ident(), []
    busy = run_async(stop.wait)

    def work(begin, end):
        seen.append((begin, threading.get_ident()))
        if begin == 0:
            stop.set()
            busy.result()
        elif threading.get_ident() == asking:
            deadline = time.monotonic() + 60
            while len({who for _, who in seen}) < 2 and time.monotonic() < deadline:
                time.sleep(0.001)  # until the other has taken one

    parallel_rows(work, 60, smallest=2, parts=6)
    assert sorted(begin for begin, _ in seen) == [0, 10, 20, 30, 40, 50]
    assert {who for begin, who in seen if begin > 0} - {asking}, "the second core came too late"


def test_an_idle_second_core_joins_within_a_part():
    stop, helped, asking = threading.Event(), threading.Event(), threading.get_ident()
    busy = run_async(stop.wait)

    def work(begin, end):
        if threading.get_ident() != asking:
            helped.set()
        elif begin == 0:
            stop.set()
            assert helped.wait(60), "the second core waits for the end of this part"

    parallel_rows(work, 2, smallest=2, parts=2)
    busy.result()


def test_work_on_the_second_core_may_share_out_rows_as_well():
    def inside():
        seen = np.zeros(12, int)

        def work(begin, end):
            seen[begin:end] += 1

        parallel_rows(work, 12, smallest=2)
        return seen

    assert (run_async(inside).result(timeout=60) == 1).all()


def test_rows_are_begun_on_a_second_core_and_finished_by_both():
    begun, asking = threading.Event(), threading.get_ident()
    taken = []

    def work(begin, end):
        taken.append((begin, threading.get_ident()))
        if threading.get_ident() != asking:
            begun.set()
            while len({who for _, who in taken}) < 2:
                time.sleep(0.001)  # until the other has taken one

    finish = begin_parallel_rows(work, 60, parts=6)
    assert begun.wait(60)
    finish()
    assert sorted(begin for begin, _ in taken) == [0, 10, 20, 30, 40, 50]
    assert {who for _, who in taken} > {asking}


def test_the_caller_does_all_rows_if_the_second_core_is_busy():
    stop, taken = threading.Event(), []
    busy = run_async(stop.wait)
    finish = begin_parallel_rows(lambda *rows: taken.append((*rows, threading.get_ident())), 4, parts=2)
    assert not taken
    finish()
    assert taken == [(0, 2, threading.get_ident()), (2, 4, threading.get_ident())]
    stop.set()
    busy.result()
    assert run_async(threading.get_ident).result() != threading.get_ident(), "and the core is used again afterwards"


def test_an_error_in_rows_that_were_begun_is_told():
    for bad in range(6):
        finish = begin_parallel_rows(lambda begin, end, bad=bad: 1 / (begin - bad), 6, parts=6)
        with pytest.raises(ZeroDivisionError):
            finish()


def test_an_error_in_any_part_is_told():
    for bad in range(6):
        with pytest.raises(ZeroDivisionError):
            parallel_rows(lambda begin, end, bad=bad: 1 / (begin - bad), 6, smallest=2, parts=6)
    assert run_async(threading.get_ident).result() != threading.get_ident()


def test_with_a_picture_on_each_core_callers_do_their_work():
    asking = threading.get_ident()
    with without_second_core():
        assert run_async(threading.get_ident).result() == asking
        with without_second_core():  # another folder at the same time
            assert run_async(threading.get_ident).result() == asking
        parts = []
        finish = begin_parallel_rows(lambda *rows: parts.append((*rows, threading.get_ident())), 2, parts=2)
        time.sleep(0.01)
        assert not parts, "nobody else begins"
        finish()
        assert [who for *_, who in parts] == [asking, asking]
        parts.clear()
        parallel_rows(lambda *rows: parts.append(rows), 2 * MIN_PARALLEL_ROWS)
        assert parts == [(0, 2 * MIN_PARALLEL_ROWS)], "in one go"
        assert run_async(threading.get_ident).result() == asking
    assert run_async(threading.get_ident).result() != asking
    with pytest.raises(ZeroDivisionError), without_second_core():
        run_async(lambda: 1 / 0).result()
    assert run_async(threading.get_ident).result() != asking


def test_parallel_map_returns_results_in_order():
    met = threading.Barrier(2, timeout=10)

    def work(number):
        if number < 2:
            met.wait()  # each waits for the other: one thread alone would never get on
        return number, threading.get_ident()

    given = parallel_map([lambda number=number: work(number) for number in range(5)])
    assert [number for number, _ in given] == list(range(5)) and len({thread for _, thread in given}) == 2
    assert parallel_map([]) == [] and parallel_map([threading.get_ident]) == [threading.get_ident()]
    with without_second_core():
        assert set(parallel_map([threading.get_ident] * 3)) == {threading.get_ident()}
    with pytest.raises(ZeroDivisionError):
        parallel_map([int, lambda: 1 // 0, int])


def no_thread(*arguments):
    raise RuntimeError("can't start new thread")


def test_without_threads_the_caller_does_all_work(monkeypatch):
    monkeypatch.setattr(threading.Thread, "start", no_thread)
    parallel._second_core.cache_clear()  # one that has no thread yet
    asking = threading.get_ident()
    assert run_async(threading.get_ident).result() == asking
    finish, seen = begin_parallel_rows(lambda *rows: seen.append(rows), 6, parts=3), []
    finish()
    assert seen == [(0, 2), (2, 4), (4, 6)]
    assert parallel_map([threading.get_ident] * 3) == [asking] * 3
    assert run_in_threads([threading.get_ident] * 3) == [asking] * 3
    monkeypatch.undo()
    assert run_async(threading.get_ident).result() != asking, "and a thread is started as soon as one can be"


def test_works_in_threads_give_what_they_give_in_their_order():
    met = threading.Barrier(3, timeout=10)
    assert run_in_threads([lambda number=number: (met.wait(), number)[1] for number in range(3)]) == [0, 1, 2]
    assert run_in_threads([]) == []
    for bad in range(3):
        with pytest.raises(ZeroDivisionError):
            run_in_threads([lambda number=number, bad=bad: 1 / (number - bad) for number in range(3)])


def test_the_second_core_keeps_nothing_of_what_it_has_done():
    class Kept:
        pass

    kept = Kept()
    here = weakref.ref(kept)
    run_async(id, kept).result()
    failed = run_async(lambda value: 1 / 0, kept)
    assert isinstance(failed.exception(), ZeroDivisionError)
    del kept, failed
    run_async(int).result()  # by then the thread has let go of the work before
    assert here() is None
