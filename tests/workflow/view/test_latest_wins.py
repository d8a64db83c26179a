"""One thread, and of all that wait only the newest is done."""

import threading
from concurrent.futures import CancelledError

import pytest

from lensfit.workflow.view.answers import LatestWins, Superseded


class Held:
    """A lane whose thread is at a job that ends when it is let go."""

    def __init__(self):
        self.lane = LatestWins("test")
        self._begun, self._go = threading.Event(), threading.Event()
        self.running = self.lane.ask(self._job)
        assert self._begun.wait(30)

    def _job(self) -> bool:
        self._begun.set()
        return self._go.wait(30)

    def let_go(self) -> None:
        self._go.set()
        assert self.running.result(timeout=30)


def test_the_newest_takes_the_place_of_those_that_wait():
    held, done = Held(), list[int]()

    def job(number: int):
        def work() -> int:
            done.append(number)
            return number

        return work

    waiting = [held.lane.ask(job(n)) for n in range(1, 201)]
    for given_up in waiting[:-1]:
        with pytest.raises(Superseded):
            given_up.result(timeout=30)
    held.let_go()
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
    held, done = Held(), list[int]()
    waiting = held.lane.ask(lambda: done.append(1))
    waiting.cancel()
    newest = held.lane.ask(lambda: done.append(2))
    held.let_go()
    newest.result(timeout=30)
    assert done == [2]


def test_at_the_end_what_is_in_work_is_waited_for_and_nothing_more_is_begun():
    held, done = Held(), list[int]()
    waiting = held.lane.ask(lambda: done.append(1))
    held.lane.end()
    with pytest.raises(CancelledError):
        waiting.result(timeout=30)
    ended = threading.Thread(target=held.lane.wait, args=(30,))
    ended.start()
    assert ended.is_alive()
    held.let_go()
    ended.join(30)
    assert not ended.is_alive()
    assert done == []
