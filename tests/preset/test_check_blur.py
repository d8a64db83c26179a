"""Blur blocks that cannot be right are refused, with the key at fault."""

from pathlib import Path

import msgspec
import pytest
from preset_makers import make_blur, make_entry, make_preset

import lensfit
from lensfit.errors import PresetError
from lensfit.preset.blocks import AberrationTerm, Blur, Pupil, Rim, Stop

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
