"""Answers of a page: the newest request counts, a typed length is read.

One thread, and of all that wait only the newest is done.
"""

import json
import math
import threading
from concurrent.futures import CancelledError
from pathlib import Path

import pytest
from view_makers import Client, served

from lensfit.errors import LensfitError
from lensfit.preset.store import load_preset
from lensfit.workflow.shoot.crew_notation import length_mm
from lensfit.workflow.view.answers import LatestWins, Superseded, typed_length_mm
from lensfit.workflow.view.lens_adjustments import LensAdjustments
from lensfit.workflow.view.lens_server import LensServer
from lensfit.workflow.view.viewed_lens import ViewedLens


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


PRIME = Path(__file__).parents[3] / "presets" / "prime_50" / "preset.json"


@pytest.mark.parametrize("text", ["1.5 m", "4'11\"", "59 1/2 in", "∞", "150cm"])
def test_a_length_is_that_of_a_shoot_file(text: str):
    assert typed_length_mm(text) == pytest.approx(length_mm(text, "", ""), rel=1e-12)


@pytest.mark.parametrize(("text", "mm"), [("800", 800), (" 1e3 ", 1000), ("-5", -5)])
def test_a_number_is_millimetres(text: str, mm: float):
    assert typed_length_mm(text) == mm


@pytest.mark.parametrize("text", ["near", "1500,0", "nan", "1e999", "5'13", "1 parsec"])
def test_what_is_no_length_is_a_sentence_of_people(text: str):
    with pytest.raises(LensfitError) as refused:
        typed_length_mm(text)
    said = str(refused.value)
    assert "=" not in said
    assert not said.startswith(":")
    assert len(said.split()) > 3


def test_pages_of_plates_and_of_lenses_answer_it(client: Client):
    lens = ViewedLens(load_preset(PRIME), "prime", LensAdjustments())
    with served(LensServer([lens])) as other:
        for one in (client, other):
            assert one.post("length", typed="2 m").json() == {"mm": 2000}
            infinite = one.post("length", typed="inf")
            assert json.loads(infinite.content) == {"mm": "inf"}
            assert one.post("length", typed="near").status == 422


def test_infinity_is_one():
    assert math.isinf(typed_length_mm("infinity"))
