"""Threads that share work: results in order, taken as needed, and no threads within threads."""

import threading
from itertools import count, islice

import pytest

from m2t_text.util import workers
from m2t_text.util.workers import AHEAD, Crew, own_cores, threaded


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
def test_a_crew_keeps_the_order_and_all_of_it_work_with_the_one_that_asks(monkeypatch, size):
    monkeypatch.setattr(workers, "cores", lambda jobs: jobs or size)
    crew = Crew()
    together = threading.Barrier(size)

    def meet(number):
        together.wait(timeout=60)
        return number, threading.get_ident()

    met = crew.map(meet, range(size))
    assert [number for number, _ in met] == list(range(size))
    assert len({thread for _, thread in met}) == size
    assert threading.get_ident() in {thread for _, thread in met}
    assert crew.map(lambda number: number * number, range(1000)) == [k * k for k in range(1000)]
    assert crew.map(abs, []) == []
    crew.close()


def test_an_error_of_any_of_a_crew_reaches_the_caller(monkeypatch):
    monkeypatch.setattr(workers, "cores", lambda jobs: jobs or 2)
    crew = Crew()
    together = threading.Barrier(2)

    def work(number):
        together.wait(timeout=60)
        return [][number] if number == 1 else number

    with pytest.raises(IndexError):
        crew.map(work, range(2))
    crew.close()
