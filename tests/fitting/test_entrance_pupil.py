"""A tape measure and a tilted chart tell where the entrance pupil is."""

from dataclasses import replace

import numpy as np
import pytest
from pinhole_shoot import FRONTAL, Camera, shoot

from lensfit.fitting.adjust import fitted_depths_mm
from lensfit.fitting.lens_states import fit
from lensfit.fitting.usual_lens import magnification_at

PUPIL_MM = 80.0
"""In front of the sensor: far more than a principal distance, as in retrofocus."""
BARREL = Camera(k=(-0.3, 0.12), centre_mm=(0.0, 0.0))
CLOSER = replace(BARREL, focal_length_mm=31.2, rotations=FRONTAL)
NOISE_PX = 0.03


def photographed(camera: Camera, focus_mm: float, seed: int):
    """Takes whose distance was measured from the sensor."""
    return [
        replace(
            take,
            name=f"{take.name} focused at {focus_mm:g}",
            focus_distance_mm=focus_mm,
            target_distance_mm=camera.distance_mm + 40.0 * k + PUPIL_MM,
        )
        for k, take in enumerate(shoot(camera, NOISE_PX, seed))
    ]


@pytest.fixture(scope="module")
def states():
    """One state with tilted views, one without."""
    takes = photographed(BARREL, 2000.0, 1) + photographed(CLOSER, 900.0, 2)
    return {one.focus_distance_mm: one for one in fit(takes).states}


def test_the_pupil_is_where_it_is(states):
    for state in states.values():
        assert state.pupil.measured
        assert state.pupil.offset_mm == pytest.approx(PUPIL_MM, abs=2.0)


def test_the_pupil_moves_as_far_as_the_lens_to_focus_nearer(states):
    """A tilt hardly tells it, so two fits of the same marks find two, and states would
    be scaled against each other by their difference."""
    focal_mm = BARREL.focal_length_mm
    near, far = (magnification_at(focal_mm, mm) for mm in (900.0, 2000.0))
    moved_mm = states[900.0].pupil.offset_mm - states[2000.0].pupil.offset_mm
    assert moved_mm == pytest.approx(focal_mm * (near - far), abs=0.1)


def test_the_error_of_the_pupil_is_stated(states):
    for state in states.values():
        deviation_mm = state.pupil.standard_deviation_mm
        assert 0.2 < deviation_mm < 10.0
        assert abs(state.pupil.offset_mm - PUPIL_MM) < 3 * deviation_mm


def test_a_state_without_tilt_gets_its_principal_distance_from_the_others_pupil(states):
    """With a thin lens' pupil it would be off by 49 mm of 900, five per cent."""
    closer = states[900.0]
    assert not closer.geometry.focal_length_free
    distance_mm = float(closer.distortion.principal_distance_mm)
    assert distance_mm == pytest.approx(CLOSER.focal_length_mm, rel=0.004)


def test_depths_are_those_that_were_measured(states):
    """Else strong distortion would be laid over the wrong angles."""
    closer = states[900.0]
    said_mm = [take.target_distance_mm for take in closer.geometry.takes]
    found_mm = fitted_depths_mm(closer.geometry.adjustment) + closer.pupil.offset_mm
    np.testing.assert_allclose(found_mm, said_mm, rtol=0.004)


@pytest.fixture(scope="module")
def frontal():
    (state,) = fit(photographed(CLOSER, 900.0, 3)).states
    return state


def test_without_tilt_depths_still_agree_with_what_was_measured(frontal):
    said_mm = [take.target_distance_mm for take in frontal.geometry.takes]
    found_mm = fitted_depths_mm(frontal.geometry.adjustment) + frontal.pupil.offset_mm
    np.testing.assert_allclose(found_mm, said_mm, rtol=0.004)


def test_without_tilt_the_stated_focal_length_places_the_pupil(frontal):
    """Scale of the picture times distance from the pupil is the principal distance, so
    that 3 % of the one are 3 % of the other."""
    assert frontal.pupil.standard_deviation_mm == pytest.approx(27.0, rel=0.15)
    assert abs(frontal.pupil.offset_mm - PUPIL_MM) < 30.0
    by_name = {one.quantity: one for one in frontal.geometry.statements}
    assert abs(by_name["focal_length"].residual_widths) < 1
    assert not any(one.contradicts for one in frontal.geometry.statements)
