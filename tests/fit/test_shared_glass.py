"""What one focus state tells another, and what is left of one that cannot use it."""

from types import SimpleNamespace

import pytest

from lensfit.errors import FitError
from lensfit.fit import shared_glass
from lensfit.fit.entrance_pupil import EntrancePupil
from lensfit.fit.shared_glass import fit_sharing_glass
from lensfit.progress import silent

TILTED_MM, FRONTAL_MM = 2000.0, 900.0
PUPIL_MM = 40.0


def take(name: str, focus_mm: float):
    return SimpleNamespace(name=name, focal_length_mm=50.0, focus_distance_mm=focus_mm)


TAKES = [take("frontal", FRONTAL_MM), take("bad", FRONTAL_MM), take("tilt", TILTED_MM)]


def state_of(group, pupil_mm):
    tilted = group[0].focus_distance_mm == TILTED_MM
    pupil = EntrancePupil(PUPIL_MM if tilted or pupil_mm else 0.0, measured=tilted)
    geometry = SimpleNamespace(
        takes=tuple(group), focal_length_free=tilted, tells_out_of_centre=False
    )
    return SimpleNamespace(
        geometry=geometry,
        pupil=pupil,
        focal_length_mm=50.0,
        distortion=SimpleNamespace(base=None),
    )


@pytest.fixture
def asked(monkeypatch):
    """States are made up; what they were fitted with is kept. Where `fails` is set, a
    state that is told the pupil cannot be fitted."""
    told = SimpleNamespace(pupils=[], fails=False)

    def fit_state(group, progress, *, pupil_mm, **more):
        told.pupils.append((group[0].focus_distance_mm, pupil_mm))
        if "bad" in {one.name for one in group}:
            raise FitError("contradicts the others", where="bad", remedy="look at it")
        if told.fails and pupil_mm is not None:
            raise FitError("no depth fits", where="frontal", remedy="measure it again")
        return state_of(group, pupil_mm)

    monkeypatch.setattr(shared_glass, "fit_state", fit_state)
    return told


def test_a_state_that_sees_no_pupil_is_fitted_with_that_of_another(asked):
    states, failed = fit_sharing_glass(TAKES, silent)
    assert asked.pupils[-1] == (FRONTAL_MM, PUPIL_MM)
    assert [s.pupil.offset_mm for s in states] == [PUPIL_MM, PUPIL_MM]
    assert [s.geometry.takes[0].name for s in states] == ["frontal", "tilt"]
    assert list(failed) == ["bad"]


def test_a_state_that_fits_only_by_itself_stays_as_it_was(asked):
    asked.fails = True
    states, failed = fit_sharing_glass(TAKES, silent)
    assert [s.pupil.offset_mm for s in states] == [0.0, PUPIL_MM]
    assert list(failed) == ["bad"]
