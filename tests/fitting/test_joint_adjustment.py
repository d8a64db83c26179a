"""What detections say of the centroid bias that was taken off: a wrong one is undone, a
true one stays."""

from dataclasses import replace

import numpy as np
import pytest
from pinhole_shoot import IMAGE_PX, MM_PER_PX, Camera, observations, take_of

from lensfit.fitting.joint_adjustment import error_amplitudes
from lensfit.fitting.lens_state import mean_held_out_rms_px
from lensfit.fitting.shared_parameters import fit_states_with_shared_parameters
from lensfit.progress import silent

pytestmark = pytest.mark.slow

NOISE_PX, BIAS_PX = 0.02, 0.6
REACH_MM = 15.0
F_NUMBERS = (4.0, 8.0, 4.0)
CAMERA = Camera(k=(-0.05, 0.0))


def coma_px(points_mm, f_number):
    """Outwards, as the square of the pupil: no map of one plane does that."""
    height = np.linalg.norm(points_mm, axis=-1, keepdims=True) / REACH_MM
    outward = points_mm / REACH_MM * height
    return BIAS_PX * (4.0 / f_number) ** 2 * outward


def barrel_px(points_mm, f_number):
    """Outwards, the same at every f-number: so does distortion."""
    del f_number
    height = np.linalg.norm(points_mm, axis=-1, keepdims=True) / REACH_MM
    return 0.05 * points_mm / REACH_MM * height**2


def ripple_px(points_mm, f_number):
    """Here and there: like no map, and none of it is in the detections."""
    del f_number
    return 0.1 * np.sin(points_mm[:, ::-1])


def photographed(bias_px=0.0):
    """One chart three times, its centroids biased by so much of `coma_px`."""
    takes = []
    for view, f_number in enumerate(F_NUMBERS):
        image = CAMERA.marks_mm(view)
        centroids = image + bias_px * MM_PER_PX * coma_px(image, f_number)
        seen = observations(centroids, NOISE_PX, view)
        takes.append(take_of(seen, f"view {view}", f_number=f_number))
    return takes


def moved(takes, by, *errors):
    """Detections less a bias of so much of `coma_px`; errors that it may have."""
    found = []
    for take in takes:
        seen = take.observations
        middle = np.asarray(IMAGE_PX) / 2
        image = (seen.points_px - middle) * MM_PER_PX
        placed = replace(
            seen, points_px=seen.points_px - by * coma_px(image, take.f_number)
        )
        shapes = [MM_PER_PX * error(image, take.f_number) for error in errors]
        shared = np.repeat(np.array(shapes)[:, None], 3, 1)
        found.append(
            replace(take, observations=placed, chief_rays=True, shared_moves_mm=shared)
        )
    return found


@pytest.fixture(scope="module")
def unbiased():
    takes = photographed()
    return takes, fit_states_with_shared_parameters(takes, silent)[0]


def test_a_bias_that_is_not_there_is_found(unbiased):
    takes, states = unbiased
    said = error_amplitudes(states, moved(takes, 1.0, coma_px, ripple_px))
    deviation = np.sqrt(np.diag(said.covariance))
    assert deviation[0] < 0.1
    assert abs(said.value[0] - 1.0) < 3 * deviation[0] + 0.02
    assert abs(said.value[1]) < 3 * deviation[1] + 0.02


def test_a_true_bias_stays():
    takes = photographed(1.0)
    states, _ = fit_states_with_shared_parameters(takes, silent)
    said = error_amplitudes(states, moved(takes, 1.0, coma_px, ripple_px))
    assert np.abs(said.value).max() < 0.1


def test_what_distortion_explains_as_well_is_as_unsure_as_it_was(unbiased):
    takes, states = unbiased
    said = error_amplitudes(states, moved(takes, 0.0, barrel_px))
    assert said.covariance[0, 0] > 0.9
    assert abs(said.value[0]) < 0.5


def test_takes_that_nothing_moved_have_no_say(unbiased):
    takes, states = unbiased
    some = [*moved(takes[:2], 1.0, coma_px), takes[2]]
    assert abs(error_amplitudes(states, some).value[0] - 1.0) < 0.1
    assert len(error_amplitudes(states, takes).value) == 0


def test_detections_moved_wrongly_leave_more_of_those_held_out(unbiased):
    """Which is when they are asked."""
    takes, states = unbiased
    wrong, _ = fit_states_with_shared_parameters(moved(takes, 1.0, coma_px), silent)
    assert mean_held_out_rms_px(states) < mean_held_out_rms_px(wrong)
