"""A tape measure and a tilted chart tell where the entrance pupil is."""

from dataclasses import replace

import numpy as np
import pytest
from pinhole_shoot import FRONTAL, Camera, shoot

from lensfit.fit.adjust import fitted_depths_mm
from lensfit.fit.lens_states import fit

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


def test_all_states_have_the_same_pupil(states):
    """A tilt hardly tells it, so two fits of the same marks find two, and states would
    be scaled against each other by their difference."""
    assert len({state.pupil.offset_mm for state in states.values()}) == 1


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


def test_without_tilt_the_pupil_is_assumed_and_depths_still_agree():
    takes = photographed(CLOSER, 900.0, 3)
    (state,) = fit(takes).states
    assert not state.pupil.measured
    distance_mm = float(state.distortion.principal_distance_mm)
    assert state.pupil.offset_mm == pytest.approx(distance_mm)
    said_mm = [take.target_distance_mm for take in takes]
    found_mm = fitted_depths_mm(state.geometry.adjustment) + distance_mm
    np.testing.assert_allclose(found_mm, said_mm, rtol=0.004)
