"""Planned wavefront shoots: sizes that suit the frame, and what each case promises."""

import numpy as np
import pytest

from data_synth.lens import set_lens
from data_synth.prescription import load_prescription
from data_synth.psf_truth import read_truth
from data_synth.sensor import Frame, Sensor
from data_synth.shoot import Camera, write_shoot
from data_synth.wavefront_cases import CASES, case_subject, frame_for, random_subject
from data_synth.wavefront_plan import (
    WavefrontPlan,
    handy,
    spot_diameter_px,
    wavefront_shots,
)
from lensfit.io.exr import read_exr
from lensfit.workflow.shoot.shoot_file import load_shoot

SIZE = (1024, 768)


def pitch_px(shot, frame, lens):
    distance_mm = shot.pose.distance_mm
    pupil_z_mm = set_lens(lens, focus_distance_mm=distance_mm).pupil_z_mm
    scale = (distance_mm + pupil_z_mm) / lens.states[0].focal_length_mm
    return shot.chart.pitch_mm / (scale * frame.pitch_mm[0])


def test_an_ordinary_shoot_is_two_stops_by_three_focus_states_a_tilt_and_lines():
    lens = load_prescription("nikkor_28")
    shots = wavefront_shots(lens, frame_for(lens, SIZE))
    assert [s.name for s in shots] == [
        "dots_f2p8_in", "dots_f2p8_near", "dots_f2p8_far",
        "dots_f5p6_in", "dots_f5p6_near", "dots_f5p6_far",
        "dots_f2p8_tilt", "lines_f8",
    ]  # fmt: skip
    assert len({s.pose for s in shots[:6]}) == 1
    near, far = shots[1].focus_distance_mm, shots[2].focus_distance_mm
    chart = shots[0].pose.distance_mm
    assert near == pytest.approx(0.715 * chart, rel=5e-3)
    assert far == pytest.approx(1.65 * chart, rel=5e-3)
    assert not shots[6].says_distance
    assert shots[6].focus_distance_mm == chart != shots[6].pose.distance_mm
    assert pitch_px(shots[0], frame_for(lens, SIZE), lens) == pytest.approx(40, abs=1)
    large = frame_for(lens, (2048, 1536))
    assert pitch_px(wavefront_shots(lens, large)[0], large, lens) == pytest.approx(
        80, abs=2
    )


@pytest.mark.parametrize("name", ["angenieux_50", "kreitzer_135", "cooke_triplet_50"])
def test_spots_out_of_focus_stay_within_their_part_of_the_pitch(name):
    lens = load_prescription(name)
    frame = frame_for(lens, SIZE)
    shots = wavefront_shots(lens, frame)
    limit_px = 0.41 * pitch_px(shots[0], frame, lens)
    for shot in shots[:3]:
        chart_mm = shot.pose.distance_mm
        spot = spot_diameter_px(lens, frame, shot.focus_distance_mm, chart_mm)
        assert spot <= limit_px


def test_cases_are_what_they_say():
    subjects = {name: case_subject(name, SIZE) for name in CASES}
    planned = ("overlapping", "tiny_dots", "cropped_grid", "left_out")
    shots = {name: subjects[name].shots() for name in planned}
    over = shots["overlapping"]
    lens, frame = subjects["overlapping"].prescription, subjects["overlapping"].camera
    spot = spot_diameter_px(lens, frame.frame, over[1].focus_distance_mm, 2000.0)
    assert spot > pitch_px(over[0], frame.frame, load_prescription("biotar_50"))
    assert subjects["saturated"].plan.brightest == 3.0
    tiny = shots["tiny_dots"][0].chart
    assert tiny.mark_mm / tiny.pitch_mm < 0.025
    assert shots["cropped_grid"][0].chart.reach_mm is not None
    assert subjects["single_focus"].plan.focus_states == ("in",)
    assert len(shots["left_out"]) == 3
    assert subjects["jpeg"].plan.form == "jpg"
    assert subjects["bayer"].camera.sensor.bayer
    assert subjects["anamorphic"].prescription.squeeze == 1.92
    assert subjects["fast"].prescription.f_number == 1.2
    with pytest.raises(ValueError, match="no case is called nosuch; there are over"):
        case_subject("nosuch", SIZE)


def test_random_lenses_follow_from_the_seed_and_keep_their_limits():
    lenses = [random_subject(number, 8, SIZE) for number in range(20)]
    again = random_subject(7, 8, SIZE)
    assert again == lenses[7]
    assert random_subject(7, 9, SIZE).prescription != again.prescription
    focal = [s.prescription.states[0].focal_length_mm for s in lenses]
    stops = [s.prescription.f_number for s in lenses]
    assert 14 <= min(focal) < 30
    assert 70 < max(focal) <= 135
    assert 1.2 <= min(stops) < 1.8
    assert 5.6 < max(stops) <= 8
    assert len({s.name.rsplit("_", 2)[0] for s in lenses[:10]}) == 10


def test_handy_numbers():
    assert handy(1234.5) == 1200
    assert handy(0.04567, 3) == 0.0457


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A small shoot by a slow lens, its chart cropped and its dots saturated."""
    folder = tmp_path_factory.mktemp("shoot")
    lens = load_prescription("cooke_triplet_50")
    frame = Frame((96, 72), (28.0, 21.0))
    plan = WavefrontPlan(
        brightest=2.0,
        reach=(0.6, 0.7),
        focus_states=("in", "near"),
        with_stopped_down=False,
    )
    shots = wavefront_shots(lens, frame, plan)
    camera = Camera(frame, Sensor(), wavelengths=1)
    write_shoot(folder, lens, camera, shots, seed=1, with_wavefront=True)
    return folder, shots


@pytest.mark.slow
def test_a_written_shoot_is_read_by_lensfit(written):
    folder, shots = written
    shoot = load_shoot(folder / "shoot.toml")
    assert [take.f_number for take in shoot.takes] == [s.f_number for s in shots]
    assert shoot.takes[2].target_distance_mm is None
    picture = read_exr(folder / "dots_f5_in.exr").parts[0].channels["G"].astype(float)
    assert picture.max() == 1.0  # saturated
    edge = np.concatenate([picture[:, :6], picture[:, -6:]], axis=1)
    assert edge.max() < 0.05  # nothing printed there


def test_a_written_shoot_holds_its_truth(written):
    folder, shots = written
    truth = read_truth(folder)
    assert truth.focus_mm == tuple(s.focus_distance_mm for s in shots[:2])
    photographed = [g for g in truth.groups if g.photographed]
    unseen = [g for g in truth.groups if not g.photographed]
    assert {g.f_number for g in photographed} == {5.0}
    assert {g.f_number for g in unseen} == {5.0, 7.07}
    assert any(g.object_distance_mm != truth.chart_distance_mm for g in unseen)
    for group, spots in zip(truth.groups, truth.psf, strict=True):
        assert spots.shape == (20, 3, group.size, group.size)
        np.testing.assert_allclose(spots.sum(axis=(2, 3)), 1.0, rtol=1e-5)
    # The middle of the table is the middle of the frame, where light is 1.
    np.testing.assert_allclose(truth.light[:, truth.light.shape[1] // 2], 1.0)
    assert (truth.light < 1.01).all()
