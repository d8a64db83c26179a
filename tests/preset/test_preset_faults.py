"""Presets that cannot be are refused: blur, covariances.

Blur blocks that cannot be right are refused, with the key at fault.
"""

from pathlib import Path

import msgspec
import pytest
from known_entries import CONTROL, covariance_of, known_entry
from preset_makers import make_blur, make_entry, make_preset

import lensfit
from lensfit.errors import PresetError
from lensfit.preset.blocks import (
    AberrationTerm,
    Blur,
    Covariance,
    LateralCovariance,
    Pupil,
    Rim,
    Stop,
)
from lensfit.preset.store import load_preset, save_preset

TERM = AberrationTerm(3, 1, 1, 1, "re", 1.0)


def rim(shift: tuple[float, float], radius: tuple[float, float]) -> Blur:
    return make_blur(pupil=Pupil(rims=(Rim(shift, radius),)))


def term(**changes) -> Blur:
    return make_blur(aberrations=(msgspec.structs.replace(TERM, **changes),))


@pytest.mark.parametrize(
    ("blur", "said"),
    [
        (make_blur(aberrations=(TERM, TERM)), "aberrations[1]: stands twice"),
        (term(order=2), "aberrations[0].order: does not go with degree 3"),
        (term(field_order=2), "aberrations[0].field_order"),
        (term(order=0, degree=2, field_degree=0, field_order=0, part="im"), ".part"),
        (term(um_by_colour=(1.0, 2.0, 3.0)), "um_by_colour: has more than 2"),
        (make_blur(stops=(Stop(2.0), Stop(2.0))), "stops: an f-number stands twice"),
        (make_blur(pupil=Pupil(blades=2)), "pupil.blades"),
        (rim((0.0, 0.0), (1.0, -2.0)), "pupil.rims[0].radius: is not positive"),
        (rim((2.5, 0.0), (1.0, 0.0)), "pupil: lets no light through"),
        (make_blur(stops=(Stop(2.0, -1.0),)), "radius_ratio"),
        (make_blur(field_radius_mm=0.0), "field_radius_mm"),
        (make_blur(focus_offset_mm=float("nan")), "focus_offset_mm"),
        (make_blur(focus_offset_mm=float("inf")), "focus_offset_mm"),
    ],
)
def test_faults_are_named(tmp_path: Path, blur: Blur, said: str):
    preset = make_preset(make_entry(blur=blur))
    with pytest.raises(PresetError) as found:
        lensfit.save_preset(preset, tmp_path / "p.json")
    assert said in str(found.value)
    assert "entries[0].blur" in str(found.value)


def test_a_rim_may_clip_beyond_the_frame(tmp_path: Path):
    """The furthest corner of the sensor is 15.8 mm off the axis; light ends at 16.6."""
    preset = make_preset(make_entry(blur=rim((1.4, 0.0), (1.0, 0.0))))
    lensfit.save_preset(preset, tmp_path / "p.json")
    assert lensfit.load_preset(tmp_path / "p.json") == preset


def test_presets_keep_every_bit_of_it(tmp_path: Path):
    preset = make_preset(known_entry())
    save_preset(preset, tmp_path / "p.json")
    assert load_preset(tmp_path / "p.json") == preset
    text = (tmp_path / "p.json").read_text()
    older = make_preset(make_entry())
    save_preset(older, tmp_path / "older.json")
    assert text.count('"covariance"') == 4
    assert (tmp_path / "older.json").read_text().count('"covariance"') == 1


GOOD = covariance_of(CONTROL, 1e-3, 0)


@pytest.mark.parametrize(
    ("bad", "what"),
    [
        ({"parameters": ("r[0]", "r[2]")}, r"'r\[2\]' is none of"),
        ({"parameters": ("r[0]", "r[0]")}, "twice"),
        ({"standard_deviation": (1e-3,)}, "needs 2 numbers"),
        ({"standard_deviation": (1e-3, -1e-3)}, "negative"),
        ({"standard_deviation": (1e-3, float("nan"))}, "no finite number"),
        ({"correlation": ((1.0,), (1.0,))}, "rows of 1 to 2"),
        ({"correlation": ((1.0,), (1.2, 1.0))}, "beyond -1 to 1"),
        ({"correlation": ((1.0,), (0.2, 0.9))}, "does not end with 1"),
    ],
)
def test_covariances_that_cannot_be_are_refused(tmp_path: Path, bad, what):
    light = known_entry().fall_off[0]
    assert light.covariance is not None
    known = msgspec.structs.replace(
        light.covariance, r=msgspec.structs.replace(GOOD, **bad)
    )
    light = msgspec.structs.replace(light, covariance=known)
    preset = make_preset(make_entry(fall_off=(light,)))
    with pytest.raises(PresetError, match=what) as fault:
        save_preset(preset, tmp_path / "p.json")
    assert "fall_off[0].covariance.r" in str(fault.value)


def test_correlations_of_no_numbers_are_refused(tmp_path: Path):
    impossible = Covariance(
        ("shift_mm[0]", "shift_mm[1]", "radial[0]"),
        (1e-3, 1e-3, 1e-3),
        ((1.0,), (0.9, 1.0), (-0.9, 0.9, 1.0)),
    )
    colour = known_entry().lateral_colour
    assert colour is not None
    known = LateralCovariance(impossible, Covariance((), (), ()))
    colour = msgspec.structs.replace(colour, covariance=known)
    preset = make_preset(make_entry(lateral_colour=colour))
    with pytest.raises(PresetError, match=r"lateral_colour\.covariance\.r\.corr"):
        save_preset(preset, tmp_path / "p.json")
