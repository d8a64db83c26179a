"""Blurs between measured states: theirs at them, smooth between, never scaled away."""

import math
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from preset_makers import make_blur, make_entry, make_preset

from lensfit.preset.blend import blended_blur
from lensfit.preset.blocks import AberrationTerm, Blur, Distortion, Projection, Stop
from lensfit.preset.entry import Entry
from lensfit.preset.photographed_stops import blended_stops, radius_ratio

COMA = AberrationTerm(3, 1, 1, 1, "re", 6.0)
NEAR = make_blur(
    aberrations=(*make_blur().aberrations, AberrationTerm(2, 2, 2, 2, "re", 8.0)),
    reference_distance_mm=1000.0,
    focus_offset_mm=0.03,
)


def with_pupil(blur: Blur, **changes) -> Blur:
    pupil = msgspec.structs.replace(blur.pupil, **changes)
    return msgspec.structs.replace(blur, pupil=pupil)


def entry_at(focus_mm: float, blur: Blur | None) -> Entry:
    return make_entry(
        focus_distance_mm=focus_mm,
        blur=blur,
        projection=Projection(51.3, (0.0, 0.0), 60.0),
        distortion=Distortion("rectilinear", 15.6, 1.02, (-0.8, -0.6, 0.8, 0.6)),
        lateral_colour=None,
    )


def test_terms_are_matched_by_what_they_are():
    """Whatever their order in the file; one that is missing counts as zero."""
    first = make_blur(aberrations=(COMA, AberrationTerm(4, 0, 0, 0, "re", 2.0, (1.0,))))
    second = make_blur(
        aberrations=(
            AberrationTerm(4, 0, 0, 0, "re", 4.0, (2.0, 4.0)),
            AberrationTerm(3, 1, 1, 1, "im", 8.0),
        )
    )
    mean = blended_blur(first, second, 0.25).aberrations
    by_part = {(t.degree, t.part): (t.um, t.um_by_colour) for t in mean}
    assert by_part == {
        (3, "re"): (4.5, ()),
        (4, "re"): (2.5, (1.25, 1.0)),
        (3, "im"): (2.0, ()),
    }


def test_numbers_move_on_their_own_scales():
    first = with_pupil(make_blur(reference_distance_mm=1000.0), squeeze=1.0)
    second = with_pupil(make_blur(reference_distance_mm=math.inf), squeeze=4.0)
    mean = blended_blur(first, second, 0.5)
    assert mean.pupil.squeeze == pytest.approx(2.0)
    assert mean.reference_distance_mm == pytest.approx(2000.0)
    shifted = blended_blur(make_blur(), make_blur(focus_offset_mm=0.05), 0.25)
    assert shifted.focus_offset_mm == pytest.approx(0.02)


def test_a_rim_that_one_neighbour_lacks_opens_wide():
    first, second = make_blur(), with_pupil(make_blur(), rims=())
    rim = blended_blur(first, second, 0.9).pupil.rims[0]
    assert rim.shift == pytest.approx(first.pupil.rims[0].shift)
    assert rim.radius[0] > 2.5
    rim = blended_blur(second, first, 1 - 1e-9).pupil.rims[1]
    assert rim.shift == pytest.approx((-0.5, 0.0))
    assert rim.radius == pytest.approx((1.2, 0.01))


def test_blades_of_different_number_are_the_nearer_ones():
    first, second = make_blur(), with_pupil(make_blur(), blades=9, blade_curvature=1.0)
    near, far = (blended_blur(first, second, w).pupil for w in (0.4, 0.6))
    assert (near.blades, near.blade_curvature) == (7, 0.4)
    assert (far.blades, far.blade_curvature) == (9, 1.0)


def test_stops_are_functions_of_the_f_number():
    stops = (Stop(2.0, 0.9), Stop(8.0, 1.1))
    assert radius_ratio(stops, 2.0) == pytest.approx(0.9)
    assert radius_ratio(stops, 4.0) == pytest.approx(math.sqrt(0.9 * 1.1))
    assert radius_ratio(stops, 1.0) == pytest.approx(0.9)
    assert radius_ratio(stops, 22.0) == pytest.approx(1.1)
    assert radius_ratio((), 4.0) == 1.0
    mean = blended_stops(stops, (Stop(4.0, 1.2),), 0.5)
    assert [stop.f_number for stop in mean] == [2.0, 4.0, 8.0]
    assert mean[0].radius_ratio == pytest.approx((0.9 + 1.2) / 2)


def test_a_measured_state_has_its_own_blur():
    preset = make_preset(entry_at(1000.0, NEAR), entry_at(2000.0, make_blur()))
    assert preset.select(50.0, 1.4, 1000.0).entry.blur == NEAR
    assert preset.select(50.0, 1.4, 2000.0).entry.blur == make_blur()


@pytest.mark.slow
def test_between_two_states_the_image_of_a_point_moves_smoothly():
    """Twenty even steps in dioptres: each moves it about as far as the next."""
    preset = make_preset(entry_at(1000.0, NEAR), entry_at(2000.0, make_blur()))
    dioptres = np.linspace(1.0, 0.5, 21)

    def image(dioptre: float) -> np.ndarray:
        lens = preset.at(50.0, 1.4, 1000.0 / dioptre)
        patch = lens.psf(
            (7.0, 4.0), 4000.0, pixel_pitch_mm=0.05, size_px=48, tolerance=0.004
        )
        return np.asarray(patch)

    images = [image(d) for d in dioptres]
    steps = np.array([np.linalg.norm(b - a) for a, b in pairwise(images)])
    assert np.linalg.norm(images[-1] - images[0]) > 0.5 * np.linalg.norm(images[-1])
    # No step stands out from its neighbours.
    expected = (steps[:-2] + steps[2:]) / 2
    np.testing.assert_allclose(steps[1:-1], expected, rtol=0.35)


def test_a_neighbour_without_blur_takes_the_other_one():
    """Blur that was not measured is not zero."""
    preset = make_preset(entry_at(1000.0, NEAR), entry_at(2000.0, None))
    for focus_mm in (1100.0, 1900.0):
        assert preset.select(50.0, 1.4, focus_mm).entry.blur == NEAR


def test_an_f_number_left_out_is_the_widest_measured():
    entry = make_entry(blur=make_blur(), fall_off=())
    assert make_preset(entry).select().f_number == 1.4
