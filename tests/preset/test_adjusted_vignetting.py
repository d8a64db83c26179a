"""Fall-off in parts: they add up to what was photographed, each by its own gain."""

from pathlib import Path

import numpy as np
import pytest
from adjusted_lenses import CORNER_MM, ideal, measured, measured_preset, plain

import lensfit
from lensfit.preset.blocks import FallOff, Pupil
from lensfit.preset.knobs import NEUTRAL, adjusted_knobs

PRESETS = Path(__file__).parents[2] / "presets"
PARTS = ("natural", "optical", "mechanical")
RADII_MM = np.linspace(0.0, CORNER_MM, 12)
POINTS = np.stack([0.8 * RADII_MM, 0.6 * RADII_MM], -1)


def loss(lens, channel="g"):
    """In stops."""
    return -np.log2(np.asarray(lens.relative_illumination(POINTS, channel)))


def gains(**own):
    return {f"{part}_vignetting_gain": own.get(part, 0.0) for part in PARTS}


@pytest.mark.parametrize("channel", ["r", "g", "b"])
def test_the_parts_add_up_to_the_photograph(channel):
    whole = loss(measured(), channel)
    each = [loss(measured(**gains(**{part: 1.0})), channel) for part in PARTS]
    assert all(part.max() > 0.02 for part in each)
    np.testing.assert_allclose(sum(each), whole, atol=0.02)


def test_without_any_part_nothing_falls_off():
    np.testing.assert_allclose(loss(measured(**gains())), 0, atol=1e-12)


def test_a_gain_leaves_the_other_parts():
    only = loss(measured(**gains(natural=1.0)))
    more = loss(measured(natural_vignetting_gain=3.0))
    np.testing.assert_allclose(more - loss(measured()), 2 * only, atol=0.02)


def test_a_gain_close_to_one_is_close_to_the_photograph():
    """The polynomial that is written down holds the photographed one exactly."""
    for part in PARTS:
        nearly = measured(**{f"{part}_vignetting_gain": 1 + 1e-9})
        np.testing.assert_allclose(loss(nearly), loss(measured()), atol=1e-6)


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("name", ["prime_50", "wide_28"])
def test_a_stated_loss_has_no_colour(name, part):
    """Also where the photographed rest is faint, and another in every colour."""
    preset = lensfit.load_preset(PRESETS / name / "preset.json")
    entry = preset.entries[0]
    knobs = gains() | {f"{part}_vignetting_gain": 1.0, f"{part}_vignetting_stops": 2.0}
    lens = preset.at(
        focal_length_mm=entry.focal_length_mm,
        focus_distance_mm=entry.focus_distance_mm,
        knobs=adjusted_knobs(NEUTRAL, knobs),
    )
    corner = np.linspace(0, 1, 12)[:, None] * np.asarray(lens.sensor_size_mm) / 2
    red, green, blue = (
        -np.log2(np.asarray(lens.relative_illumination(corner, c))) for c in "rgb"
    )
    np.testing.assert_allclose(red, green, atol=0.02)
    np.testing.assert_allclose(blue, green, atol=0.02)
    assert (np.diff(green) > -1e-6).all()
    assert green[6] < 1.0
    assert green[8] > 0.02  # rims of these lenses clip from half the field on
    np.testing.assert_allclose(green[-1], 2.0, atol=0.03)


def test_illumination_never_rises_outwards_nor_above_one():
    for knobs in (gains(mechanical=5.0), gains(optical=2.0), {"cat_eye_gain": 2.0}):
        assert (np.diff(loss(measured(**knobs))) > -1e-9).all()


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("make", [measured, ideal])
def test_a_stated_loss_is_that_of_the_corner(make, part):
    lens = make(**(gains(**{part: 1.0}) | {f"{part}_vignetting_stops": 1.5}))
    np.testing.assert_allclose(loss(lens)[-1], 1.5, atol=0.03)
    assert 0 < loss(lens)[6] < 1.0


def test_natural_vignetting_of_an_ideal_lens_is_the_fourth_power_of_the_cosine():
    natural = 4 * np.log2(np.hypot(1, RADII_MM / 50))
    lens = ideal(natural_vignetting_stops=float(natural[-1]))
    np.testing.assert_allclose(loss(lens), natural, atol=0.005)


def test_what_shows_no_loss_has_none_to_turn():
    for knobs in (gains(), gains(natural=9.0), {"cat_eye_gain": 0.0}):
        np.testing.assert_allclose(loss(ideal(**knobs)), 0, atol=1e-12)


def test_without_a_cats_eye_its_vignetting_is_gone_too():
    """When the photograph shows what the pupil does, nothing of the rims is left."""
    seen = measured_preset(fall_off=(FallOff(1.4, 15.9, *3 * ((0.1, 0.9, 2.5),)),))
    off = loss(measured(seen, optical_vignetting_gain=0.0))
    np.testing.assert_allclose(loss(measured(seen, cat_eye_gain=0.0)), off, atol=0.02)
    assert (loss(measured(seen)) - off)[-1] > 0.2
    assert loss(measured(seen, cat_eye_gain=1.4))[-1] > loss(measured(seen))[-1] + 0.2


def test_a_stated_cats_eye_darkens_an_ideal_lens_by_what_it_hides():
    lens = ideal(cat_eye_percent=40.0)
    np.testing.assert_allclose(loss(lens)[-1], -np.log2(0.6), atol=0.03)


def test_a_pupil_without_rims_leaves_the_rest_to_mechanical_parts():
    bare = plain(measured_preset(), pupil=Pupil(stretch_along=(-0.08, 0.01)))
    np.testing.assert_allclose(
        loss(measured(bare, optical_vignetting_gain=0.0)),
        loss(measured(bare)),
        atol=1e-6,
    )
