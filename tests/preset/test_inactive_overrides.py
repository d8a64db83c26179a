"""A knob that finds nothing to turn says so, and names what would put some in."""

import jax
import msgspec
import numpy as np
import pytest
from adjusted_lenses import CORNER_MM, TERMS, ideal, measured, measured_preset
from preset_makers import make_entry, make_preset

from lensfit.preset.inactive_overrides import knobs_that_state
from lensfit.preset.knobs import GROUP_OF, NEUTRAL, adjusted_knobs

GAINS = sorted(n for n in GROUP_OF if n.endswith("_gain") and GROUP_OF[n] != "look")
SIZES = {"cat_eye_gain": ("cat_eye_percent",)}
AMOUNT = 8.0


def idle(lens):
    return [note for note in lens.notes if "has no effect" in note]


def seen(lens):
    """All that a picture is made of: chief rays and fall-off in three colours, blur."""
    point = np.array([[0.6 * CORNER_MM, 0.5 * CORNER_MM]])
    found = [lens.distorted_from_undistorted(point, c).ravel() for c in "rgb"]
    found += [lens.relative_illumination(point, c) for c in "rgb"]
    found += [np.ravel(leaf) for leaf in jax.tree.leaves(lens.blur)]
    return np.concatenate(found)


def stated_by(gain):
    return SIZES.get(gain) or knobs_that_state(gain.removesuffix("_gain"))


@pytest.mark.parametrize("gain", GAINS)
def test_of_an_ideal_lens_no_gain_turns_anything_and_each_says_what_would(gain):
    lens = ideal(**{gain: 2.0})
    (note,) = idle(lens)
    assert note.startswith(f"{gain} has no effect: ")
    assert np.array_equal(seen(lens), seen(ideal()))
    for knob in stated_by(gain):
        assert f"--{knob.replace('_', '-')}" in note
        assert idle(ideal(**{gain: 2.0, knob: AMOUNT})) == []
        once, twice = ideal(**{knob: AMOUNT}), ideal(**{gain: 2.0, knob: AMOUNT})
        assert not np.array_equal(seen(once), seen(ideal()))
        assert not np.array_equal(seen(twice), seen(once))


@pytest.mark.parametrize("gain", GAINS)
def test_a_gain_of_what_was_measured_has_no_note(gain):
    assert idle(measured(**{gain: 2.0})) == []


@pytest.mark.parametrize("gain", GAINS)
def test_nothing_is_said_of_neutral_gains_and_of_what_is_turned_off(gain):
    assert idle(ideal(**{gain: 1.0})) == idle(ideal(**{gain: 0.0})) == []


@pytest.mark.parametrize(
    ("gain", "kept"),
    [
        ("coma_gain", lambda t: t.order != 1),
        ("spherical_gain", lambda t: t.order != 0 or t.degree == 2),
        ("field_curvature_gain", lambda t: (t.degree, t.order) != (2, 0)),
        ("astigmatism_sagittal_gain", lambda t: (t.degree, t.order) != (2, 2)),
        ("axial_colour_gain", lambda t: (t.degree, t.order) != (2, 0)),
    ],
)
def test_a_measured_lens_may_lack_one_family(gain, kept):
    preset = measured_preset(*filter(kept, TERMS))
    (note,) = idle(measured(preset, **{gain: 2.0}))
    assert note.startswith(gain)
    assert idle(measured(preset, other_aberrations_gain=2.0)) == []


def test_a_preset_without_blur_and_lateral_colour_says_so_for_each_and_once():
    preset = make_preset(make_entry(lateral_colour=None))
    lens = measured(preset, coma_gain=2.0, lateral_red_gain=2.0, distortion_gain=2.0)
    assert [note.split()[0] for note in idle(lens)] == ["lateral_red_gain", "coma_gain"]


def test_of_a_blur_at_an_f_number_that_nobody_knows_nothing_is_claimed():
    entry = measured_preset().entries[0]
    fall_off = (msgspec.structs.replace(entry.fall_off[0], f_number=None),)
    preset = make_preset(msgspec.structs.replace(entry, fall_off=fall_off))
    knobs = adjusted_knobs(NEUTRAL, {"coma_gain": 2.0, "roundness": 0.5})
    assert idle(preset.at(50.0, knobs=knobs)) == []


@pytest.mark.parametrize("knob", ["roundness", "blade_rotation_deg"])
def test_a_round_opening_cannot_be_turned_or_rounded(knob):
    lens = ideal(**{knob: 0.5})
    (note,) = idle(lens)
    assert "--blades" in note
    assert np.array_equal(seen(lens), seen(ideal()))
    assert idle(ideal(blades=6, **{knob: 0.5})) == []
