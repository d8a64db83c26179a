"""Which deviations of a preset's maps are known: as measured, between, and turned."""

import msgspec
import numpy as np
import pytest
from known_entries import NAMES, POINTS, covariance_of, known_entry, lens_of
from preset_makers import make_blur, make_entry, make_preset

from lensfit.errors import LensfitError
from lensfit.lens import Lens
from lensfit.preset.predicted_fall_off import with_predicted_fall_off

ASKED = {
    "distortion": lambda lens: lens.position_standard_deviation_mm(POINTS),
    "lateral colour": lambda lens: lens.lateral_colour_standard_deviation_mm(
        POINTS, "b"
    ),
    "fall-off": lambda lens: lens.illumination_standard_deviation(POINTS),
}


def unknown_of(lens: Lens) -> set[str]:
    """What the lens says it does not know."""
    found: dict[str, str] = {}
    for what, ask in ASKED.items():
        try:
            ask(lens)
        except LensfitError as fault:
            found[what] = str(fault)
    for what, told in found.items():
        assert f"how well its {what} is known" in told
        assert "calibrate its photographs again with this version" in told
    return set(found)


def test_presets_that_do_not_say_tell_what_to_do():
    assert unknown_of(lens_of(known_entry())) == set()
    assert unknown_of(lens_of(make_entry(covariance=None))) == set(ASKED)
    # Parameters that nobody can name the effect of.
    assert unknown_of(lens_of(make_entry())) == set(ASKED)


def test_fields_counted_with_gaps_are_understood():
    """The fit has room for more of the field than it keeps, and older presets counted
    that."""
    plain = tuple(f"free_field[{k}]" for k in range(8))
    gaps = (*plain[:4], *(f"free_field[{k}]" for k in range(18, 22)))
    told, older = (
        lens_of(
            known_entry(
                covariance=msgspec.structs.replace(
                    covariance_of(plain, 1e-5, 3), parameters=names
                )
            )
        ).position_standard_deviation_mm(POINTS)
        for names in (plain, gaps)
    )
    np.testing.assert_array_equal(told, older)
    partly = known_entry(covariance=covariance_of(gaps[3:5], 1e-5, 3))
    assert unknown_of(lens_of(partly)) == {"distortion"}


def test_nothing_is_known_between_photographed_states():
    near = known_entry()
    far = msgspec.structs.replace(near, focus_distance_mm=4000.0)
    preset = make_preset(near, far)
    assert unknown_of(preset.at(50.0, 1.4, 4000.0)) == set()
    assert unknown_of(preset.at(50.0, 1.4, 3000.0)) == set(ASKED)
    assert unknown_of(preset.at(50.0, 2.0, 4000.0)) == {"fall-off"}
    colourless = msgspec.structs.replace(far, lateral_colour=None, fall_off=())
    other = make_preset(near, colourless)
    assert unknown_of(other.at(50.0, 1.4, 3000.0)) == set(ASKED)


def test_predicted_fall_off_has_no_deviation():
    entry = with_predicted_fall_off(known_entry(blur=make_blur()))
    preset = make_preset(entry)
    assert unknown_of(preset.at(50.0, 8.0)) == {"fall-off"}
    assert unknown_of(preset.at(50.0, 2.8)) == set()


def test_gains_take_deviations_with_them():
    entry = known_entry()
    lens = lens_of(entry)
    doubled = lens_of(entry, lateral_red_gain=2.0, lateral_blue_gain=0.0)
    for channel, gain in (("r", 2.0), ("b", 0.0)):
        np.testing.assert_allclose(
            doubled.lateral_colour_standard_deviation_mm(POINTS, channel),
            gain * lens.lateral_colour_standard_deviation_mm(POINTS, channel),
            rtol=1e-9,
        )
    none = msgspec.structs.replace(entry, covariance=covariance_of(NAMES[3:5], 1e-4, 0))
    flat = lens_of(none, distortion_gain=0.0)
    assert lens_of(none).position_standard_deviation_mm(POINTS).max() > 1e-5
    assert not flat.position_standard_deviation_mm(POINTS).any()


@pytest.mark.parametrize(
    ("knobs", "unknown"),
    [
        ({"distortion_percent": -3.0}, "distortion"),
        ({"lateral_blue_um": 8.0}, "lateral colour"),
        ({"natural_vignetting_gain": 0.5}, "fall-off"),
        ({"optical_vignetting_stops": 0.5}, "fall-off"),
    ],
)
def test_what_was_stated_is_not_known(knobs, unknown):
    assert unknown_of(lens_of(known_entry(), **knobs)) == {unknown}
