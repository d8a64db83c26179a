"""First-order data, focus and f-number against closed forms and published lenses."""

import dataclasses
import math

import numpy as np
import pytest

from data_synth.aim import (
    chief_aim_mm,
    chief_landings_mm,
    rays_through_pupil,
    tracer_from_object,
)
from data_synth.glass import Glass
from data_synth.lens import set_lens
from data_synth.paraxial import first_order
from data_synth.prescription import load_prescription, prescription_names
from data_synth.surfaces import Surface
from data_synth.trace import vertex_positions_mm

GLASS = Glass("cauchy", (1.6, 0.0, 0.0))
D_NM = 587.5618


def test_thick_lens_follows_the_lensmaker():
    r1, r2, t, n = 50.0, -80.0, 12.0, 1.6
    lens = (
        Surface(1 / r1, 1 / r1, t, glass=GLASS),
        Surface(1 / r2, 1 / r2, 30.0, is_stop=True),
    )
    power = (n - 1) * (1 / r1 - 1 / r2 + (n - 1) * t / (n * r1 * r2))
    data = first_order(lens, D_NM)
    assert data.focal_length_mm == pytest.approx(1 / power, rel=1e-12)
    back = (1 - (n - 1) * t / (n * r1)) / power
    assert data.back_focus_mm == pytest.approx(back, rel=1e-12)


def test_pupils_are_images_of_the_stop():
    """A stop 10 mm behind a thin lens of f = 50: 1/s' = 1/50 - 1/10, m = s'/s."""
    curvature = 1 / (0.6 * 50)
    lens = (
        Surface(curvature, curvature, 0.0, glass=GLASS),
        Surface(0.0, 0.0, 10.0),
        Surface(0.0, 0.0, 40.0, is_stop=True),
    )
    data = first_order(lens, D_NM)
    assert data.entrance_pupil_z_mm - (-50.0) == pytest.approx(12.5)
    assert data.entrance_pupil_magnification == pytest.approx(1.25)
    assert data.exit_pupil_z_mm == pytest.approx(-40.0)
    assert data.exit_pupil_magnification == pytest.approx(1.0)


STATES = [
    pytest.param(prescription, state, id=f"{prescription.name}-{state.focal_length_mm}")
    for prescription in map(load_prescription, prescription_names())
    for state in prescription.states
]


@pytest.mark.parametrize(("prescription", "state"), STATES)
def test_published_lenses_have_their_focal_length_and_a_sharp_axis(prescription, state):
    lens = set_lens(prescription, focal_length_mm=state.focal_length_mm)
    assert lens.focal_length_mm == pytest.approx(state.focal_length_mm, rel=0.01)
    radius = 0.7 * lens.stop.radius_mm
    pupil = first_order(lens.surfaces, 546.07)
    height = radius * abs(pupil.entrance_pupil_magnification)
    aim = np.column_stack([np.zeros(9), np.linspace(-height, height, 9)])
    axis = np.tile([0.0, 0.0, -1e9], (9, 1))
    traced, _ = rays_through_pupil(lens, axis, aim, 546.07)
    assert traced.passed.all()
    assert np.abs(traced.landing_mm).max() < 0.04


@pytest.mark.parametrize(("prescription", "state"), STATES)
def test_published_lenses_keep_the_image_where_a_photograph_expects_it(
    prescription, state
):
    """Distortion of a few per cent, growing smoothly to the corner."""
    distance = 40 * state.focal_length_mm
    lens = set_lens(
        prescription,
        focal_length_mm=state.focal_length_mm,
        focus_distance_mm=distance,
    )
    half = np.array(prescription.sensor_size_mm) / 2
    depth = distance + lens.pupil_z_mm
    ray = np.linspace(0.02, 1.0, 12)[:, None] * half / lens.focal_length_mm * depth
    ray[:, 0] *= prescription.squeeze
    object_mm = np.column_stack([ray, np.full(12, distance)])
    landing = chief_landings_mm(lens, tracer_from_object(object_mm), 540.0)
    scale = np.hypot(*landing.T) / np.hypot(*object_mm[:, :2].T)
    distortion = scale / scale[0] - 1
    limit = 0.09 if prescription.squeeze != 1 else 0.04
    assert np.abs(distortion).max() < limit
    assert (np.diff(np.hypot(*landing.T)) > 0).all()


def test_floating_elements_go_where_the_patent_has_them():
    """Focused by rays at the object distance of its near state, 803.34 before the first
    surface; the published spaces are to rounding those of a straight cam."""
    design = load_prescription("arri_100")
    length_mm = sum(s.thickness_mm for s in set_lens(design).surfaces)
    near = set_lens(design, focus_distance_mm=803.34 + length_mm)
    spaces = [near.surfaces[k].thickness_mm for k in (7, 11, 20)]
    assert spaces == pytest.approx([1.10, 10.843, 20.359], abs=0.35)
    assert sum(s.thickness_mm for s in near.surfaces) == pytest.approx(length_mm)


def test_a_nearer_focus_moves_the_lens_out_by_newtons_formula():
    prescription = load_prescription("cooke_triplet_50")
    far = set_lens(prescription)
    near = set_lens(prescription, focus_distance_mm=1000.0)
    extension = near.surfaces[-1].thickness_mm - far.surfaces[-1].thickness_mm
    f = far.focal_length_mm
    data = first_order(far.surfaces, 546.07)
    front_focus = vertex_positions_mm(near.surfaces)[0] - f  # close to it for this lens
    assert extension == pytest.approx(f * f / (1000.0 + front_focus), rel=0.05)
    assert data.back_focus_mm == pytest.approx(far.surfaces[-1].thickness_mm, rel=0.02)


def test_front_group_focusing_leaves_the_rear_where_it_is():
    prescription = load_prescription("itoh_zoom")
    far = set_lens(prescription)
    near = set_lens(prescription, focus_distance_mm=1500.0)
    changed = [
        i
        for i, (a, b) in enumerate(zip(far.surfaces, near.surfaces, strict=True))
        if a.thickness_mm != b.thickness_mm
    ]
    assert changed == [7]


def test_f_number_is_focal_length_over_pupil_diameter():
    prescription = load_prescription("biotar_50")
    for f_number in (1.4, 2.8, 8.0):
        lens = set_lens(prescription, f_number=f_number)
        diameter = 2 * lens.pupil_radius_mm
        assert lens.focal_length_mm / diameter == pytest.approx(f_number, rel=1e-9)


@pytest.mark.parametrize("name", prescription_names())
def test_chief_rays_cross_the_centre_of_the_real_stop(name):
    lens = set_lens(load_prescription(name), focus_distance_mm=1500.0, f_number=8.0)
    half = np.array(lens.prescription.sensor_size_mm) / lens.focal_length_mm * 700
    points = np.array([[0.0, 0], [0.9, 0], [0, -0.9], [0.8, 0.8]]) * half
    points = np.column_stack([points, np.full(4, -1500.0)])
    aim = chief_aim_mm(lens, points, 540.0)
    traced, _ = rays_through_pupil(lens, points, aim, 540.0)
    assert np.abs(traced.stop_mm).max() < 1e-9


def test_a_centred_lens_is_symmetric_and_a_decentred_one_is_not():
    prescription = load_prescription("nikkor_28")
    points = np.array([[400.0, 300, 1500], [-400.0, -300, 1500], [400.0, -300, 1500]])

    def landings(change=None):
        lens = set_lens(prescription, focus_distance_mm=1500.0, change=change)
        return chief_landings_mm(lens, tracer_from_object(points), 540.0)

    centred = landings()
    np.testing.assert_allclose(centred[0], -centred[1], atol=1e-9)
    np.testing.assert_allclose(centred[0] * [1, -1], centred[2], atol=1e-9)
    assert (centred[0] > 0).all()  # the photograph is upright

    def slip(surfaces):
        shifted = [
            dataclasses.replace(s, decentre_mm=(0.2, 0.0)) if i in (4, 5) else s
            for i, s in enumerate(surfaces)
        ]
        return tuple(shifted)

    slipped = landings(slip)
    assert abs((slipped[0] + slipped[1])[0]) > 1e-3


def test_unknown_prescription_is_named():
    with pytest.raises(ValueError, match="no prescription named nosuch"):
        load_prescription("nosuch")


def test_anamorphic_squeezes_the_image():
    lens = set_lens(load_prescription("schneider_31"))
    squeeze = (
        lens.focal_length_mm / first_order(lens.surfaces, D_NM, "x").focal_length_mm
    )
    assert squeeze == pytest.approx(lens.prescription.squeeze, rel=0.01)
    assert math.isinf(lens.focus_distance_mm)
