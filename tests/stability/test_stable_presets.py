"""Presets of any numbers: what is written is what is read."""

import json
import math
from pathlib import Path

import hypothesis.strategies as st
import msgspec
import numpy as np
import pytest
from examples import examples
from hypothesis import given

import lensfit
from lensfit.errors import PresetError
from lensfit.preset.blocks import Camera, Covariance, Distortion, FallOff, Projection
from lensfit.preset.entry import Entry, Quality
from lensfit.preset.schema import LensName, Preset, Provenance
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset

PRESETS = sorted((Path(__file__).parents[2] / "presets").glob("*/preset.json"))
any_number = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(5e-324, 1.7e308)
place = st.floats(-1e9, 1e9)
length, f_number = st.floats(5e-324, 1e9), st.floats(5e-324, 1000.0)
distance = st.one_of(positive, st.just(math.inf))
text = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)


def bits(numbers) -> bytes:
    """Tells 0 from -0, and the last bit."""
    return np.array(numbers, float).tobytes()


@st.composite
def entries(draw) -> Entry:
    """Every float that a preset may hold, subnormal and huge ones too; lengths and
    f-numbers as a lens may have them."""
    control = sorted(draw(st.lists(st.floats(0, 50.0), min_size=3, max_size=3)))
    low = draw(st.floats(-1e300, 0, exclude_max=True))
    high = draw(st.floats(0, 1e300, exclude_min=True))
    names = ("a1", "a2")
    spread = draw(st.floats(1e-150, 1e150))
    matrix = np.array([[1.0, 0.5], [0.5, 1.0]]) * spread
    return Entry(
        focal_length_mm=draw(length),
        focus_distance_mm=draw(distance),
        projection=Projection(draw(length), (draw(place), draw(place)), draw(place)),
        distortion=Distortion(
            base=draw(st.sampled_from(["rectilinear", "stereographic", "equidistant"])),
            reference_radius_mm=draw(length),
            valid_radius=draw(positive),
            valid_box=(low, low, high, high),
            radial_log_slope=tuple(draw(st.lists(any_number, max_size=6))),
            squeeze=draw(positive),
            squeeze_axis_rad=draw(any_number),
        ),
        lateral_colour=None,
        fall_off=(FallOff(draw(f_number), draw(positive), *[tuple(control)] * 3),),
        terms=(),
        covariance=Covariance.from_matrix(names, matrix),
        quality=Quality(0.0, None, 0, 0, 0),
    )


@examples(60)
@given(entry=entries(), name=text)
def test_presets_survive_their_file(entry, name, tmp_path_factory, measured):
    """Round trip of a preset of any numbers (5e-324 to 1.8e308, -0, infinity) and any
    name: equal to the bit, and the same file again."""
    preset = Preset(
        lens=LensName(name),
        camera=Camera(None, 36.0, 24.0, 3600, 2400),
        entries=(entry,),
        provenance=Provenance("2025-01-31T12:00:00+00:00", "0.1.0", {}, ()),
    )
    folder = tmp_path_factory.mktemp("round", numbered=True)
    lensfit.save_preset(preset, folder / "a.json")
    loaded = lensfit.load_preset(folder / "a.json")
    lensfit.save_preset(loaded, folder / "b.json")
    assert loaded == preset
    one, other = (folder / f"{n}.json" for n in "ab")
    measured("bytes of the file", one.read_bytes() != other.read_bytes(), 0)
    mine, its = (
        bits((*e.distortion.radial_log_slope, *e.projection.principal_point_mm))
        for e in (entry, loaded.entries[0])
    )
    measured("bits of its numbers", mine != its, 0)


@pytest.mark.parametrize("path", PRESETS, ids=lambda path: path.parent.name)
def test_the_presets_here_survive(path: Path, tmp_path: Path, measured):
    """Round trip of each preset of the repository: the same JSON values."""
    lensfit.save_preset(lensfit.load_preset(path), tmp_path / "p.json")
    again = json.loads((tmp_path / "p.json").read_text())
    measured("differences", json.loads(path.read_text()) != again, 0)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 0.0, -1.0])
@pytest.mark.parametrize("key", ["focal_length_mm", "focus_distance_mm"])
def test_no_such_number(key: str, value: float, tmp_path: Path, measured):
    """NaN, zero or less in a preset: not written, in one line (infinite focus is)."""
    preset = thin_lens_preset(ThinCamera(50.0, 2.0, 2.0, 36.0, 96, 64))
    entry = msgspec.structs.replace(preset.entries[0], **{key: value})
    changed = msgspec.structs.replace(preset, entries=(entry,))
    if key == "focus_distance_mm" and value == math.inf:
        lensfit.save_preset(changed, tmp_path / "p.json")
        assert lensfit.load_preset(tmp_path / "p.json") == changed
        measured("lines of the refusal", 0, 1)
        return
    with pytest.raises(PresetError, match=key) as caught:
        lensfit.save_preset(changed, tmp_path / "p.json")
    assert not (tmp_path / "p.json").exists()
    measured("lines of the refusal", str(caught.value).count("\n") + 1, 1)
