"""Threads that share work: results in order, taken as needed, and no threads within threads."""

import threading
from concurrent.futures import ProcessPoolExecutor
from itertools import count, islice
from multiprocessing import get_context

import pytest

from m2t_text.util import workers
from m2t_text.util.workers import AHEAD, own_cores, threaded, together


def test_results_keep_their_order_and_items_are_taken_as_needed(monkeypatch):
    monkeypatch.setattr(workers, "cores", lambda jobs: jobs or 3)
    taken = []

    def items():
        for number in count():
            taken.append(number)
            yield number

    assert list(islice(threaded(lambda number: number * number, items()), 50)) == [k * k for k in range(50)]
    assert len(taken) <= 50 + 3 * AHEAD + 1


def test_an_item_is_worked_on_by_one_thread(monkeypatch):
    monkeypatch.setattr(workers, "cores", lambda jobs: jobs or 3)
    main = threading.get_ident()

    def inside(_):
        within = list(threaded(lambda _: threading.get_ident(), range(5)))
        return own_cores(), set(within) == {threading.get_ident()}, threading.get_ident() != main

    assert list(threaded(inside, range(9))) == [(1, True, True)] * 9
    assert own_cores() == 3


def test_an_error_reaches_the_caller(monkeypatch):
    monkeypatch.setattr(workers, "cores", lambda jobs: jobs or 2)
    with pytest.raises(ZeroDivisionError):
        list(threaded(lambda number: 1 // (5 - number), range(100)))
    assert own_cores() == 2


@pytest.mark.parametrize("size", [1, 2, 3])
def test_many_works_keep_their_order_and_the_caller_does_its_share(monkeypatch, size):
    monkeypatch.setattr(workers, "cores", lambda jobs: jobs or size)
    barrier = threading.Barrier(size)

    def meet(number):
        barrier.wait(timeout=60)
        return number, threading.get_ident()

    for _ in range(2):
        met = together(meet, range(size))
        assert [number for number, _ in met] == list(range(size))
        assert len({thread for _, thread in met}) == size
        assert threading.get_ident() in {thread for _, thread in met}
    assert together(lambda number: number * number, range(1000)) == [k * k for k in range(1000)]
    assert together(abs, []) == []


@pytest.mark.parametrize("failing", [0, 1])
def test_an_error_of_any_of_them_reaches_the_caller_once_nobody_works(monkeypatch, failing):
    monkeypatch.setattr(workers, "cores", lambda jobs: jobs or 2)
    barrier, done = threading.Barrier(2), []

    def work(number):
        if number < 2:
            barrier.wait(timeout=60)
        done.append(number)
        return [][number] if number == failing else number

    with pytest.raises(IndexError):
        together(work, range(4))
    before = len(done)
    assert together(abs, [-1, -2]) == [1, 2] and len(done) == before


def test_a_process_that_was_forked_has_threads_of_its_own(monkeypatch):
    monkeypatch.setattr(workers, "cores", lambda jobs: jobs or 2)
    assert together(abs, [-1, -2]) == [1, 2]  # this one has them now
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool:
        assert pool.submit(threads_of_two).result(timeout=60) == 2


def threads_of_two():
    barrier = threading.Barrier(2)

    def meet(_):
        barrier.wait(timeout=60)
        return threading.get_ident()

    return len(set(together(meet, range(2))))
