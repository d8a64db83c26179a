"""Made lenses: reproducible, still focused, still the same kind of lens."""

import dataclasses

import numpy as np
import pytest

from data_synth.aim import chief_landings_mm, tracer_from_object
from data_synth.lens import set_lens
from data_synth.paraxial import first_order
from data_synth.prescription import load_prescription, prescription_names
from data_synth.sensor import Frame
from data_synth.spots import field_points_mm
from data_synth.tolerances import (
    _open_areas,
    behind_meniscus,
    elements,
    perturbed,
    scaled,
    with_rims_closed,
)
from data_synth.wavefront_plan import spot_diameter_px

FRAME = Frame((1024, 768), (24.0, 18.0))


@pytest.mark.parametrize("name", prescription_names())
def test_elements_are_glass_between_air_and_air(name):
    surfaces = load_prescription(name).surfaces
    found = elements(surfaces)
    inside = {k for first, last in found for k in range(first, last)}
    glass = {k for k, s in enumerate(surfaces) if s.glass.refractive_index(540.0) > 1}
    assert inside == glass


def test_scaling_scales_everything():
    lens = load_prescription("compact_39")
    half = scaled(lens, 19.5)
    focal = [first_order(p.surfaces, 546.0).focal_length_mm for p in (lens, half)]
    assert focal[1] == pytest.approx(focal[0] / 2)
    frames = [Frame((1024, 768), p.sensor_size_mm) for p in (lens, half)]
    spots = [
        spot_diameter_px(p, f, 40 * p.states[0].focal_length_mm, 1560.0 * k)
        for p, f, k in zip((lens, half), frames, (1.0, 0.5), strict=True)
    ]
    assert spots[1] == pytest.approx(spots[0], rel=1e-3)


def test_a_seed_makes_one_lens():
    lens = load_prescription("petzval_50")
    assert perturbed(lens, 4) == perturbed(lens, 4)
    assert perturbed(lens, 4) != perturbed(lens, 5)
    assert perturbed(lens, 4, strength=0.0).surfaces == lens.surfaces


def test_elements_move_as_a_whole_and_the_iris_stays():
    made = perturbed(load_prescription("biotar_50"), 1)
    for first, last in elements(made.surfaces):
        parts = made.surfaces[first : last + 1]
        assert len({s.tilt_rad for s in parts}) == 1
        assert all(s.is_displaced for s in parts)
        gap = np.ptp([s.decentre_mm for s in parts], axis=0)
        assert (gap < 0.03).all()
    assert not made.surfaces[5].is_displaced


def test_decentring_throws_the_picture_aside_but_keeps_the_focus():
    lens = load_prescription("nikkor_28")
    made = perturbed(lens, 3, strength=2.0)
    spots = [spot_diameter_px(p, FRAME, 1120.0, 1120.0) for p in (lens, made)]
    assert spots[1] < spots[0] + 4.0
    axis = tracer_from_object(np.array([[0.0, 0.0, 1120.0]]))
    set_to = set_lens(made, focus_distance_mm=1120.0)
    assert np.hypot(*chief_landings_mm(set_to, axis, 540.0)[0]) > 0.005


def test_closed_rims_leave_a_third_of_the_corner_and_all_of_the_axis():
    lens = dataclasses.replace(load_prescription("biotar_50"), f_number=2.0)
    before = _open_areas(lens, FRAME)
    after = _open_areas(with_rims_closed(lens, FRAME), FRAME)
    assert after[0] / after[1] == pytest.approx(1 / 3, abs=0.01)
    assert after[0] < 0.8 * before[0]
    assert after[1] > 0.99 * before[1]


def test_a_meniscus_in_front_bends_straight_lines_like_a_barrel():
    wide = behind_meniscus(load_prescription("nikkor_28"))
    focal_mm = wide.states[0].focal_length_mm
    assert 18 < focal_mm < 22
    frame = Frame((1024, 768), (26.0, 19.5))
    lens = set_lens(wide, f_number=5.6, focus_distance_mm=40 * focal_mm)
    points = field_points_mm(lens, frame, ((0.02, 0.95), (0.95,)), 40 * focal_mm)
    near, corner = points[:, 1]
    assert corner > 1.1 * near  # the frame's edge is a bent line of the scene
