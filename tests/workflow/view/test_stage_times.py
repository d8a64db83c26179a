"""How far the stages of a calibration are, and how long they took."""

import pytest

from lensfit.workflow.view import calibration_run
from lensfit.workflow.view.calibration_run import StageTimes


class Clock:
    """A clock that is set by hand."""

    now_s = 0.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(calibration_run, "time", made)
    return made


def test_a_stage_counts_its_seconds_until_it_is_done(clock: Clock):
    times = StageTimes()
    for done in range(3):
        times.tell("detect", done, 2)
        clock.now_s += 10
    [stage] = times.facts(running=True)
    assert stage == {
        "stage": "detect", "done": 2, "total": 2, "round": 1, "seconds": 20
    }  # fmt: skip


def test_a_stage_in_work_counts_on_until_the_run_ends(clock: Clock):
    times = StageTimes()
    times.tell("fit", 0, 5)
    clock.now_s += 7
    assert times.facts(running=True)[0]["seconds"] == 7
    assert times.facts(running=False)[0]["seconds"] == 0


def test_a_stage_that_begins_anew_is_in_its_next_round(clock: Clock):
    times = StageTimes()
    for done in (1, 5):
        times.tell("fit", done, 5)
        clock.now_s += 10
    times.tell("wavefront", 1, 4)
    clock.now_s += 100
    times.tell("fit", 1, 5)
    clock.now_s += 5
    fit, wavefront = times.facts(running=True)
    assert (fit["done"], fit["round"], fit["seconds"]) == (1, 2, 15)
    assert (wavefront["done"], wavefront["round"]) == (1, 1)
