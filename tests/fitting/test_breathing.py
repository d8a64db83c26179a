"""Breathing against that of a lens that moves as a whole, near and far swapped."""

from types import SimpleNamespace

import numpy as np
import pytest

from lensfit.fitting.breathing import inverse_pupil_magnification, reversed_breathing
from lensfit.fitting.statements import PUPIL_MAGNIFICATION_WIDTH
from lensfit.optics.paraxial import FirstOrder, first_order_of, magnification
from lensfit.workflow.statements import contradictions


def state(focus_mm, principal_mm, target_mm=2000.0, focal_mm=50.0):
    take = SimpleNamespace(target_distance_mm=target_mm)
    return SimpleNamespace(
        focal_length_mm=focal_mm,
        focus_distance_mm=focus_mm,
        distortion=SimpleNamespace(principal_distance_mm=principal_mm),
        geometry=SimpleNamespace(takes=(take,)),
    )


NEAR_MM, FAR_MM = 1300.0, 3300.0
EXTENDED, DRAWN_IN = 52.0, 50.8
"""c = f + f^2 / (s - f), of a thin lens."""


def test_a_lens_that_moves_as_a_whole_is_not_remarked_on():
    assert not reversed_breathing([state(NEAR_MM, EXTENDED), state(FAR_MM, DRAWN_IN)])


def test_swapped_focus_distances_are_remarked_on():
    found = reversed_breathing([state(FAR_MM, EXTENDED), state(NEAR_MM, DRAWN_IN)])
    assert found.keys() == {50.0}
    assert "2.4 % larger focused at 3300 mm than at 1300 mm" in found[50.0]


@pytest.mark.parametrize(("told_apart", "accused"), [(True, 0), (False, 1)])
def test_swapping_is_suspected_where_the_blur_does_not_tell(told_apart, accused):
    wavefront = SimpleNamespace(
        fits_stated_side=told_apart, mirrored=False, has=lambda _: False
    )
    fitted = SimpleNamespace(
        states=[state(FAR_MM, EXTENDED), state(NEAR_MM, DRAWN_IN)],
        wavefronts={50.0: wavefront},
    )
    found = [*contradictions.contradictions_of_fit([], fitted)]
    assert len([one for one in found if one.kind == "side_of_focus"]) == accused


def test_infinity_is_farther_than_any_distance():
    found = reversed_breathing([state(float("inf"), 51.0), state(NEAR_MM, 50.0)])
    assert "focused at inf mm" in found[50.0]


@pytest.mark.parametrize("unknown", ["focus", "target"])
def test_what_was_not_measured_says_nothing(unknown):
    focus = None if unknown == "focus" else FAR_MM
    target = None if unknown == "target" else 2000.0
    states = [state(focus, EXTENDED, target), state(NEAR_MM, DRAWN_IN)]
    assert not reversed_breathing(states)


def test_focal_lengths_are_not_compared_with_each_other():
    states = [state(NEAR_MM, EXTENDED), state(FAR_MM, 90.0, focal_mm=85.0)]
    assert not reversed_breathing(states)


def principal_distances_mm(focal_mm, m_p, from_pupil_mm):
    """c = f (1 - m / m_p), with the entrance pupil at the sensor."""
    lens = FirstOrder(focal_mm, m_p, 0.0)
    return focal_mm * (1 - magnification(lens, from_pupil_mm) / m_p)


@pytest.mark.parametrize("m_p", [0.32, 1.0, 2.2, -3.0])
def test_breathing_is_that_of_the_pupil_magnification(m_p):
    """Of a lens that moves as a whole, whatever was stated, within what it may be."""
    from_pupil_mm = np.array([2600.0, 3600.0, 6000.0])
    c_mm = principal_distances_mm(90.0, m_p, from_pupil_mm)
    for stated_mm in (88.0, 90.0, 93.0):
        found = inverse_pupil_magnification(c_mm, 1 / from_pupil_mm, stated_mm, 0.03)
        assert found == pytest.approx(1 / m_p, abs=0.15)
        focal_mm = first_order_of(c_mm[1], 1 / found, 0.0, from_pupil_mm[1])
        assert focal_mm.focal_length_mm == pytest.approx(90.0, rel=4e-3)


def test_one_focus_distance_says_little_of_the_pupil():
    """What was stated and what is usual share the difference by their widths."""
    c_mm = principal_distances_mm(90.0, 0.32, np.array([3600.0]))
    found = inverse_pupil_magnification(c_mm, np.array([1 / 3600.0]), 90.0, 0.03)
    assert 1.0 < found < 1 + 1.2 * PUPIL_MAGNIFICATION_WIDTH


def test_nothing_is_learnt_of_the_pupil_focused_at_infinity():
    found = inverse_pupil_magnification(np.array([91.0]), np.zeros(1), 90.0, 0.03)
    assert found == pytest.approx(1.0, abs=1e-12)
