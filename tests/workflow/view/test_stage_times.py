"""How long a stage of a calibration still takes, or that nobody knows."""

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


def left_s(times: StageTimes) -> float | None:
    return times.facts(running=True)[-1]["left_s"]


def test_even_steps_tell_the_time_left(clock: Clock):
    times = StageTimes()
    times.tell("detect", 0, 4)
    assert left_s(times) is None
    for done in (1, 2):
        clock.now_s += 10
        times.tell("detect", done, 4)
    assert left_s(times) == pytest.approx(20)
    clock.now_s += 4
    assert left_s(times) == pytest.approx(16)
    assert times.facts(running=False)[0]["left_s"] is None


def test_a_step_longer_than_those_before_has_no_time_left(clock: Clock):
    times = StageTimes()
    for done in range(4):
        times.tell("fit", done, 4)
        clock.now_s += 10
    assert left_s(times) is None
    clock.now_s += 60
    assert left_s(times) is None


def test_a_first_step_tells_nothing(clock: Clock):
    times = StageTimes()
    times.tell("fit", 0, 4)
    clock.now_s += 10
    times.tell("fit", 1, 4)
    assert left_s(times) is None
