"""From the file to the lens that computes, and back."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from preset_makers import make_blur, make_entry, make_preset

import lensfit
from lensfit.preset.lens_of_entry import distortion_block


def test_the_lens_knows_its_state_and_how_it_was_reached():
    preset = make_preset(make_entry(), make_entry(focus_distance_mm=1000.0))
    lens = preset.at(focal_length_mm=50.5, f_number=2.0, focus_distance_mm=1500.0)
    assert (lens.focal_length_mm, lens.f_number) == (50.0, 2.0)
    assert lens.focus_distance_mm == 1500.0
    assert lens.sensor_size_mm == (24.89, 18.6675)
    assert lens.notes == (
        "focal length 50.5 mm taken as the measured 50 mm",
        "blur was not measured; a perfect lens stands in for it",
    )


WIDER = (
    "the blur wider open than f/1.4, the widest f-number it was photographed at, is "
    "the model's prediction: its aberrations are extrapolated to the rim of the wider "
    "pupil"
)
FARTHER = (
    "the blur more than a stop beyond f/2.8, the narrowest stop it was photographed "
    "at, is the model's prediction"
)


@pytest.mark.parametrize(
    ("f_number", "says"),
    [(0.7, WIDER), (1.0, WIDER), (1.3, WIDER), (4.5, FARTHER), (11.0, FARTHER)],
)
def test_blur_beyond_the_photographed_f_numbers_is_noted(f_number, says):
    """Of f/1.4 and f/2.8, in one sentence, whatever the fall-off says."""
    lens = make_preset(make_entry(blur=make_blur())).at(f_number=f_number)
    assert [note for note in lens.notes if "the blur" in note] == [says]


@pytest.mark.parametrize("f_number", [None, 1.4, 1.37, 2.0, 2.8, 4.0])
def test_blur_at_and_near_the_photographed_f_numbers_is_not(f_number):
    lens = make_preset(make_entry(blur=make_blur())).at(f_number=f_number)
    assert not any("the blur" in note for note in lens.notes)


def test_a_blur_of_no_known_f_number_says_nothing_of_them():
    preset = make_preset(make_entry(blur=make_blur(stops=())))
    for f_number in (0.7, 11.0):
        assert not any("the blur" in n for n in preset.at(f_number=f_number).notes)


def test_distortion_survives_file_and_lens():
    entry = make_entry()
    lens = make_preset(entry).at()
    block = distortion_block(lens.distortion)
    full = entry.distortion
    trimmed = msgspec.structs.replace(
        full,
        decentering=full.decentering[:2],
        squeeze=block.squeeze,
        squeeze_axis_rad=block.squeeze_axis_rad,
    )
    assert block == trimmed
    assert block.squeeze == pytest.approx(full.squeeze, rel=1e-15)
    assert block.squeeze_axis_rad == pytest.approx(full.squeeze_axis_rad, rel=1e-12)


def test_a_squeeze_narrows_its_own_axis():
    distortion = msgspec.structs.replace(
        make_entry().distortion,
        radial_log_slope=(),
        decentering=(),
        field=None,
        squeeze=2.0,
        squeeze_axis_rad=0.0,
    )
    entry = make_entry(distortion=distortion, lateral_colour=None)
    lens = make_preset(entry).at()
    axis = np.array([entry.projection.principal_point_mm])
    moved = lens.distorted_from_undistorted(axis + np.array([[1.0, 0.0]])) - axis
    raised = lens.distorted_from_undistorted(axis + np.array([[0.0, 1.0]])) - axis
    np.testing.assert_allclose(moved, [[1 / math.sqrt(2), 0.0]], atol=1e-12)
    np.testing.assert_allclose(raised, [[0.0, math.sqrt(2)]], atol=1e-12)


@pytest.mark.parametrize("channel", ["r", "g"])
def test_a_loaded_preset_inverts_its_own_map(tmp_path: Path, channel):
    lensfit.save_preset(make_preset(), tmp_path / "p.json")
    lens = lensfit.load_preset(tmp_path / "p.json").at(50.0, 1.4, 2000.0)
    points = np.random.default_rng(7).uniform((-12, -9), (12, 9), (200, 2))
    there = lens.distorted_from_undistorted(points, channel)
    back = lens.undistorted_from_distorted(there, channel)
    np.testing.assert_allclose(back, points, atol=1e-11)
