"""The second core: results and errors come back from it, and nobody waits for another's work on it."""

import threading

import numpy as np
import pytest

from z2p_core.threads import SMALLEST, beside, in_halves, one_core_each, over_rows


def test_work_is_done_on_another_thread_and_its_result_comes_back():
    assert beside(threading.get_ident).result() != threading.get_ident()
    assert beside(lambda x, y: x + y, 2, 3).result() == 5


def test_errors_come_back_from_either_thread():
    stop = threading.Event()
    busy = beside(stop.wait)
    here = beside(lambda: 1 / 0)
    stop.set()
    busy.result()
    for future in (here, beside(lambda: 1 / 0)):
        with pytest.raises(ZeroDivisionError):
            future.result()


def test_while_the_second_core_is_busy_work_is_done_at_once_here():
    stop = threading.Event()
    busy = beside(stop.wait)
    try:
        assert beside(threading.get_ident).result(timeout=0) == threading.get_ident()
    finally:
        stop.set()
        busy.result()
    free = beside(threading.get_ident).result()
    assert free != threading.get_ident(), "and the core is used again afterwards"


@pytest.mark.parametrize("count", [1, SMALLEST - 1, SMALLEST, 2 * SMALLEST + 1])
def test_halves_are_joined_in_order(count):
    numbers, table = np.arange(count), np.arange(3 * count).reshape(-1, 3)
    doubled, same = in_halves(lambda x, y: (2 * x, y), numbers, table)
    np.testing.assert_array_equal(doubled, 2 * numbers)
    np.testing.assert_array_equal(same, table)


@pytest.mark.parametrize("count", [0, 1, SMALLEST - 1, SMALLEST, 2 * SMALLEST + 1])
def test_every_row_is_worked_on_once(count):
    seen = np.zeros(count, int)

    def work(first, last):
        seen[first:last] += 1

    over_rows(work, count)
    assert (seen == 1).all()


def test_with_a_picture_on_each_core_work_is_done_by_the_thread_that_asks():
    asking = threading.get_ident()
    with one_core_each():
        assert beside(threading.get_ident).result() == asking
        with one_core_each():  # another folder at the same time
            assert beside(threading.get_ident).result() == asking
        assert beside(threading.get_ident).result() == asking
    assert beside(threading.get_ident).result() != asking
    with pytest.raises(ZeroDivisionError), one_core_each():
        beside(lambda: 1 / 0).result()
    assert beside(threading.get_ident).result() != asking
