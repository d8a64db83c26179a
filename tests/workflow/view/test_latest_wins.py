"""One thread, and of all that wait only the newest is done."""

import threading

import pytest

from lensfit.workflow.view.latest_wins import LatestWins, Superseded


def test_the_newest_takes_the_place_of_those_that_wait():
    lane, begun, go = LatestWins("test"), threading.Event(), threading.Event()
    done: list[int] = []

    def first() -> int:
        begun.set()
        assert go.wait(30)
        return 0

    def job(number: int):
        def work() -> int:
            done.append(number)
            return number

        return work

    running = lane.ask(first)
    assert begun.wait(30)
    waiting = [lane.ask(job(n)) for n in range(1, 201)]
    for given_up in waiting[:-1]:
        with pytest.raises(Superseded):
            given_up.result(timeout=30)
    go.set()
    assert running.result(timeout=30) == 0
    assert waiting[-1].result(timeout=30) == 200
    assert done == [200]


def test_a_failure_is_the_asker_s_and_the_lane_goes_on():
    lane = LatestWins("test")

    def fails() -> None:
        raise ValueError("no picture")

    with pytest.raises(ValueError, match="no picture"):
        lane.ask(fails).result(timeout=30)
    assert lane.ask(lambda: 7).result(timeout=30) == 7


def test_one_that_was_cancelled_is_not_done():
    lane, begun, go = LatestWins("test"), threading.Event(), threading.Event()
    done: list[int] = []

    def first() -> bool:
        begun.set()
        return go.wait(30)

    running = lane.ask(first)
    assert begun.wait(30)
    waiting = lane.ask(lambda: done.append(1))
    waiting.cancel()
    newest = lane.ask(lambda: done.append(2))
    go.set()
    assert running.result(timeout=30)
    newest.result(timeout=30)
    assert done == [2]
