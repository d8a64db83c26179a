"""What one focus state tells another, and what is left of one that cannot use it."""

from dataclasses import make_dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from lensfit.errors import FitError
from lensfit.fitting import shared_parameters
from lensfit.fitting.entrance_pupil import EntrancePupil
from lensfit.fitting.shared_parameters import fit_states_with_shared_parameters
from lensfit.fitting.usual_lens import KnownPerspective, KnownPupil, KnownPupilShift
from lensfit.progress import silent

TILTED_MM, FRONTAL_MM = 2000.0, 900.0
PUPIL_MM = 40.0
NO_DECENTRING = {"decentering": np.zeros(4)}


State = make_dataclass(
    "State",
    [
        "geometry",
        "pupil",
        "focal_length_mm",
        "focus_distance_mm",
        "distortion",
        "pupil_shift",
        "uncertainty",
    ],
    eq=False,
)
"""What of a lens state is asked here."""


def take(name: str, focus_mm: float):
    return SimpleNamespace(
        name=name, focal_length_mm=50.0, corner_mm=15.0, focus_distance_mm=focus_mm
    )


TAKES = [take("frontal", FRONTAL_MM), take("bad", FRONTAL_MM), take("tilt", TILTED_MM)]


def state_of(group, known):
    tilted = group[0].focus_distance_mm == TILTED_MM
    offset_mm = PUPIL_MM if tilted else known.offset_mm if known else 0.0
    deviation_mm = 1.0 if tilted or known else 30.0
    pupil = EntrancePupil(offset_mm, tilted, deviation_mm)
    geometry = SimpleNamespace(
        takes=tuple(group), focal_length_free=tilted, adjustment=None
    )
    return State(
        geometry=geometry,
        pupil=pupil,
        focal_length_mm=50.0,
        focus_distance_mm=group[0].focus_distance_mm,
        distortion=SimpleNamespace(base=None),
        pupil_shift=None,
        uncertainty=SimpleNamespace(deviation=lambda _: (0.01, 0.01)),
    )


@pytest.fixture
def asked(monkeypatch):
    """States are made up; what they were fitted with is kept. Where `fails` is set, a
    state that is told the pupil cannot be fitted."""
    told = SimpleNamespace(pupils=[], decentring=[], fails=False)

    def fit_state(group, progress, *, perspective, known_decentring, **more):
        told.pupils.append((group[0].focus_distance_mm, perspective))
        told.decentring.append(known_decentring)
        if "bad" in {one.name for one in group}:
            raise FitError("contradicts the others", where="bad", remedy="look at it")
        if told.fails and perspective is not None:
            raise FitError("no depth fits", where="frontal", remedy="measure it again")
        return state_of(group, perspective and perspective.pupil)

    monkeypatch.setattr(shared_parameters, "fit_state", fit_state)
    monkeypatch.setattr(shared_parameters, "decentring_of", lambda _: NO_DECENTRING)
    return told


def test_a_state_that_sees_no_pupil_is_fitted_with_that_of_another(asked):
    states, failed = fit_states_with_shared_parameters(TAKES, silent)
    focus_mm, perspective = asked.pupils[-1]
    known = perspective.pupil
    assert focus_mm == FRONTAL_MM
    moved_mm = known.offset_mm - PUPIL_MM
    assert 0 < moved_mm < known.standard_deviation_mm * (1 + 1e-9)
    assert known.common_deviation_mm == 1.0
    assert [s.pupil.offset_mm for s in states] == [known.offset_mm, PUPIL_MM]
    assert [s.geometry.takes[0].name for s in states] == ["frontal", "tilt"]
    assert list(failed) == ["bad"]


def test_frontal_views_are_told_that_tilted_ones_found_no_decentring(asked):
    fit_states_with_shared_parameters(TAKES, silent)
    assert asked.decentring[0] is None
    assert asked.decentring[-1] is NO_DECENTRING


def test_a_state_that_fits_only_by_itself_stays_as_it_was(asked):
    asked.fails = True
    states, failed = fit_states_with_shared_parameters(TAKES, silent)
    assert [s.pupil.offset_mm for s in states] == [0.0, PUPIL_MM]
    assert list(failed) == ["bad"]


def test_a_state_whose_pupil_shift_is_known_better_is_fitted_again(asked, monkeypatch):
    surer = KnownPerspective(
        KnownPupil(PUPIL_MM, 1.0), KnownPupilShift(-18.0, 0.5, 12.0)
    )
    monkeypatch.setattr(
        shared_parameters, "perspective_with_pupil_shift", lambda *_: surer
    )
    monkeypatch.setattr(
        shared_parameters, "pupil_shift_with_shared_errors", lambda _: None
    )
    states, _ = fit_states_with_shared_parameters(TAKES, silent)
    assert (TILTED_MM, surer) in asked.pupils
    focus_mm, told = asked.pupils[-1]
    assert focus_mm == FRONTAL_MM
    assert told is not surer
    assert [s.geometry.takes[0].name for s in states] == ["frontal", "tilt"]
