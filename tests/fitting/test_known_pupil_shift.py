"""How the entrance pupil shifts with field angle: by tilted charts, or as is usual."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from pinhole_shoot import FRONTAL, LATTICE, PITCH_MM, TILTED, Camera, observations
from pinhole_shoot import take_of as stated

from lensfit.detect.observations import only
from lensfit.fitting.chart_view import View
from lensfit.fitting.entrance_pupil import (
    FittedPupilShift,
    perspective_with_pupil_shift,
)
from lensfit.fitting.joint_adjustment import pupil_shift_with_shared_errors
from lensfit.fitting.lens_states import fit
from lensfit.fitting.usual_lens import usual_pupil_shift
from lensfit.fitting.view_stack import board_of, observed_of
from lensfit.optics.many_points import undistort
from lensfit.workflow.calibration.entries import entry_of

SHIFT_MM, CHART_MM = -24.0, 900.0
CAMERA = Camera(30.0, (0.0, 0.0), k=(-0.05, 0.0))


def photographed(
    rotations, focus_mm: float, shift_mm: float = SHIFT_MM, noise_px: float = 0.02
) -> list[View]:
    """A pinhole that stands farther back for steeper rays."""
    camera = Camera(
        CAMERA.focal_length_mm, CAMERA.centre_mm, k=CAMERA.k, rotations=rotations
    )
    takes = []
    for view in range(len(rotations)):
        points = camera.camera_axes(view, LATTICE * PITCH_MM)
        across = (points[:, :2] ** 2).sum(-1)
        pupil_mm = 0.0
        for _ in range(20):
            ahead = points[:, 2] - pupil_mm
            pupil_mm = shift_mm * across / (across + ahead**2)
        points[:, 2] -= pupil_mm
        image = camera.image_mm(points)
        seen = observations(image, noise_px, view)
        inside = (np.abs(image) < [12.0, 9.0]).all(-1)
        name = f"view {view} focused at {focus_mm:g}"
        takes.append(stated(only(seen, inside), name, focus_distance_mm=focus_mm))
    return takes


@pytest.fixture(scope="module")
def states():
    """One state with tilted views, one without."""
    takes = photographed(TILTED, 2000.0) + photographed(FRONTAL[:1], 900.0)
    return {one.focus_distance_mm: one for one in fit(takes).states}


def test_tilted_views_show_the_shift(states):
    pupil_shift = states[2000.0].pupil_shift
    assert pupil_shift.standard_deviation_mm < 4.0
    off = abs(pupil_shift.shift_mm - SHIFT_MM)
    assert off < max(3 * pupil_shift.standard_deviation_mm, 0.15 * abs(SHIFT_MM))


def test_states_without_tilt_share_it(states):
    pupil_shift, told = states[900.0].pupil_shift, states[2000.0].pupil_shift
    assert pupil_shift.shift_mm == pytest.approx(told.shift_mm, abs=0.01 * 30.0)
    assert pupil_shift.standard_deviation_mm >= told.standard_deviation_mm
    assert pupil_shift.measured


def test_the_preset_tells_it_with_the_distance_of_the_chart(states):
    pupil_shift = entry_of(states[900.0]).projection.pupil_shift
    assert pupil_shift is not None
    assert pupil_shift.shift_mm == states[900.0].pupil_shift.shift_mm
    pupil_mm = states[900.0].pupil.offset_mm
    ahead_mm = pupil_shift.chart_distance_mm - pupil_mm
    # As well as the stated focal length is known.
    assert ahead_mm == pytest.approx(CHART_MM, rel=0.06)


def test_frontal_views_say_nothing():
    (state,) = fit(photographed(FRONTAL[:1], 900.0)).states
    assert state.pupil_shift is None
    assert entry_of(state).projection.pupil_shift is None


def test_lines_of_a_lone_chart_come_out_straight():
    """A single plane shows no shift: the map takes up what a tilted chart has of it."""
    [take] = photographed(TILTED[:1], 900.0)
    (state,) = fit([take]).states
    straight_mm = np.asarray(undistort(observed_of(take), state.distortion))
    plane = board_of(take)
    homography, _ = cv2.findHomography(plane, straight_mm)
    left_mm = cv2.perspectiveTransform(plane[None], homography)[0] - straight_mm
    px_per_mm = take.observations.image_size_px[0] / take.sensor_size_mm[0]
    left_px = np.sqrt(np.mean(np.sum(left_mm**2, -1))) * px_per_mm
    assert left_px < 1.2 * state.geometry.held_out_rms_px
    assert state.uncertainty.deviation("pupil_shift")[0] == pytest.approx(0.5, rel=0.05)


def test_of_what_no_photograph_shows_the_usual_is_told_as_assumed():
    [take] = photographed(FRONTAL[:1], 900.0)
    take = replace(take, f_number=2.0, target_distance_mm=CHART_MM + 30.0)
    (state,) = fit([take]).states
    projection = entry_of(state).projection
    usual = usual_pupil_shift(take.focal_length_mm, 2.0, take.corner_mm)
    assert projection.pupil_shift is not None
    assert projection.pupil_shift.shift_mm == pytest.approx(usual.shift_mm, abs=0.5)
    assert "pupil_shift" in projection.assumed


def test_what_photographs_show_outweighs_the_usual():
    takes = [
        replace(take, f_number=8.0, target_distance_mm=CHART_MM + 30.0)
        for take in photographed(TILTED, 2000.0)
    ]
    (state,) = fit(takes).states
    assert state.pupil_shift.measured
    assert abs(state.pupil_shift.shift_mm - SHIFT_MM) < 0.2 * abs(SHIFT_MM)
    assert "pupil_shift" not in entry_of(state).projection.assumed


@pytest.mark.slow
def test_an_assumed_shift_needs_an_f_number_a_distance_and_one_pupil():
    [take] = photographed(FRONTAL[:1], 900.0)
    known = replace(take, f_number=2.0, target_distance_mm=900.0)
    for lacking in (
        replace(known, f_number=None),
        replace(known, target_distance_mm=None),
        replace(known, squeeze=2.0),
    ):
        (state,) = fit([lacking]).states
        assert state.pupil_shift is None


def test_many_sharp_points_tell_that_a_pupil_stands_still():
    (state,) = fit(photographed(TILTED, 2000.0, 0.0, noise_px=0.0023)).states
    assert abs(state.pupil_shift.shift_mm) < 3 * state.pupil_shift.standard_deviation_mm
    assert state.pupil_shift.standard_deviation_mm < 3.0


@pytest.mark.slow
def test_errors_that_marks_share_are_not_taken_for_a_shift():
    """Marks of tilted views are moved by as much as another shift of the pupil would
    move them, and say that errors may do that."""
    still, moved = (photographed(TILTED, 2000.0, mm, 0.005) for mm in (0.0, -12.0))
    takes = []
    for one, other in zip(still, moved, strict=True):
        known = {tuple(c): k for k, c in enumerate(one.observations.lattice.tolist())}
        rows = np.array([
            known.get(tuple(c), -1) for c in other.observations.lattice.tolist()
        ])  # fmt: skip
        seen = only(other.observations, rows >= 0)
        there = seen.points_px - one.observations.points_px[rows[rows >= 0]]
        moves = np.repeat((there * other.pixel_mm)[None, None], 3, axis=1)
        takes.append(replace(other, observations=seen, shared_moves_mm=moves))
    (state,) = fit(takes).states
    fitted = replace(state, pupil_shift=FittedPupilShift(-12.0, 20.0))
    found = pupil_shift_with_shared_errors(fitted)
    adjustment = state.geometry.adjustment
    row = adjustment.layout.blocks["pupil_shift"].start
    unit_mm = float(adjustment.frame.stated_focal_length_mm)
    assert adjustment.parameters[row] * unit_mm == pytest.approx(-12.0, abs=2.0)
    assert abs(found.shift_mm) < found.standard_deviation_mm
    assert 4.0 < found.standard_deviation_mm < 15.0


def test_a_shift_within_what_is_known_stays(states):
    geometry = states[2000.0].geometry
    fitted = FittedPupilShift(-20.0, 30.0)
    assert (
        perspective_with_pupil_shift(geometry, fitted, FittedPupilShift(-14.0, 7.0))
        is None
    )
    assert perspective_with_pupil_shift(geometry, fitted, None) is None
    assert perspective_with_pupil_shift(geometry, None, None) is None
    known = perspective_with_pupil_shift(geometry, fitted, FittedPupilShift(-12.0, 7.0))
    assert known.pupil_shift.shift_mm == -12.0
    assert 7.0 < known.pupil_shift.common_deviation_mm < 7.5
    assert known.pupil == geometry.facts.perspective.pupil
