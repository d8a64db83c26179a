"""Interpolation between measured states: exact at them, physical between them."""

import itertools
import math

import msgspec
import numpy as np
import pytest
from preset_makers import make_entry, make_preset

from lensfit.errors import PresetError
from lensfit.preset import blocks
from lensfit.preset.blend import blend
from lensfit.preset.blocks import FallOff
from lensfit.preset.entry import Entry


def entry_at(focal: float, focus: float, principal: float, **changes) -> Entry:
    """An entry that differs from `make_entry` in its state and principal distance."""
    entry = make_entry(focal_length_mm=focal, focus_distance_mm=focus, **changes)
    projection = msgspec.structs.replace(
        entry.projection, principal_distance_mm=principal
    )
    return msgspec.structs.replace(entry, projection=projection)


def test_a_single_entry_serves_when_nothing_is_asked():
    preset = make_preset()
    chosen = preset.select()
    assert chosen.f_number == 1.4
    assert chosen.notes == ()
    assert chosen.entry.projection == preset.entries[0].projection


def test_measured_states_come_back_exactly():
    entries = [
        entry_at(focal, focus, focal + focus / 1e5)
        for focal in (24.0, 50.0, 70.0)
        for focus in (500.0, 1000.0, math.inf)
        if focus != math.inf
    ]
    preset = make_preset(*entries)
    for entry in entries:
        chosen = preset.select(entry.focal_length_mm, 2.8, entry.focus_distance_mm)
        assert chosen.entry.projection == entry.projection
        assert chosen.entry.distortion == entry.distortion
        assert chosen.notes == ()


def test_breathing_of_a_thin_lens_is_followed_exactly():
    # 1/c = 1/f - 1/z, with z from the pupil, which the entries have 60 mm ahead.
    f = 50.0

    def image_distance(focus: float) -> float:
        return 1 / (1 / f - 1 / (focus - 60))

    measured = [math.inf, 4000.0, 2000.0, 1000.0]
    preset = make_preset(*(entry_at(f, s, image_distance(s)) for s in measured))
    for focus in (1e9, 8000.0, 3000.0, 1300.0):
        entry = preset.select(f, 2.8, focus).entry
        expected = image_distance(focus)
        assert entry.projection.principal_distance_mm == pytest.approx(
            expected, rel=1e-12
        )
        assert entry.focus_distance_mm == focus


def test_a_zoom_is_linear_in_focal_length_and_monotone():
    entries = [entry_at(f, 2000.0, 1.02 * f) for f in (24.0, 35.0, 70.0)]
    preset = make_preset(*entries)
    focal_lengths = np.linspace(24, 70, 47)
    got = [
        preset.select(f, 2.8, 2000.0).entry.projection.principal_distance_mm
        for f in focal_lengths
    ]
    np.testing.assert_allclose(got, 1.02 * focal_lengths, rtol=1e-12)


def test_states_that_are_not_used_have_nothing_to_note():
    near, far = (entry_at(50.0, focus, 50.0) for focus in (1000.0, 2000.0))
    predicted = tuple(
        msgspec.structs.replace(one, predicted=True) for one in near.fall_off
    )
    preset = make_preset(msgspec.structs.replace(near, fall_off=predicted), far)
    assert preset.select(50.0, 2.8, 2000.0).notes == ()
    (note,) = preset.select(50.0, 2.8, 1000.0).notes
    assert "predicted" in note
    assert preset.select(50.0, 2.8, 1500.0).notes == (note,)


def test_focus_beyond_what_was_measured_is_clamped_with_a_note():
    preset = make_preset(entry_at(50, 1000.0, 52.6), entry_at(50, 2000.0, 51.3))
    chosen = preset.select(50.0, 2.8, 500.0)
    assert chosen.entry.projection.principal_distance_mm == 52.6
    assert chosen.entry.focus_distance_mm == 500.0
    assert "focus distance 500 mm is outside what was measured" in chosen.notes[0]
    assert "fall-off are those of 1000 mm" in chosen.notes[0]


def test_focus_where_the_lens_has_no_image_is_refused():
    prime = make_preset(entry_at(50, 1000.0, 52.6))
    zoom = make_preset(entry_at(50, 1000.0, 52.6), entry_at(50, 2000.0, 51.3))
    for preset in (prime, zoom):
        with pytest.raises(PresetError, match=r"50 mm has no image of what is 1.5 mm"):
            preset.select(50.0, 2.8, 1.5)
        preset.select(50.0, 2.8, 250.0)
        preset.select(50.0, 2.8, np.inf)
    offset_mm = prime.entries[0].projection.entrance_pupil_offset_mm
    with pytest.raises(PresetError, match=f"only beyond {offset_mm + 50:.0f} mm"):
        prime.select(50.0, 2.8, offset_mm + 49)


def test_a_prime_tolerates_the_scatter_of_metadata_and_no_more():
    preset = make_preset()
    chosen = preset.select(51.6, 2.8, 2000.0)
    assert chosen.entry.focal_length_mm == 50.0
    assert chosen.notes == ("focal length 51.6 mm taken as the measured 50 mm",)
    with pytest.raises(PresetError, match="focal length 35 mm is not in the preset"):
        preset.select(35.0)


def test_what_must_be_said_is_asked_for():
    zoom = make_preset(entry_at(24, 2000.0, 24), entry_at(70, 2000.0, 70))
    with pytest.raises(PresetError, match="holds focal lengths 24 to 70 mm"):
        zoom.select()
    prime = make_preset(entry_at(50, 1000.0, 52), entry_at(50, 2000.0, 51))
    with pytest.raises(PresetError, match=r"1000, 2000 mm.*--focus-distance-mm"):
        prime.select(50.0)
    with pytest.raises(PresetError, match="f_number = 0 is not positive"):
        prime.select(50.0, 0.0)
    with pytest.raises(PresetError, match="not one of a lens"):
        prime.select(50.0, 1e9)


def test_fall_off_between_stops_lies_between_them():
    wide, narrow = (0.2, 1.0), (0.1, 0.2)
    stops = (
        FallOff(1.4, 15.0, wide, wide, wide),
        FallOff(5.6, 15.0, narrow, narrow, narrow),
    )
    preset = make_preset(make_entry(fall_off=stops))
    (middle,) = preset.select(50.0, 2.8).entry.fall_off
    assert middle.f_number == 2.8
    assert middle.g == pytest.approx((0.15, 0.6))
    chosen = preset.select(50.0, 8.0)
    assert chosen.entry.fall_off[0].g == narrow
    assert "fall-off at f/8 was not measured; f/5.6 is used" in chosen.notes


def test_fall_offs_of_other_degree_and_radius_are_averaged_as_functions():
    straight, bent = (0.4,), (0.0, 0.3, 0.9)
    first = FallOff(2.0, 15.0, straight, straight, straight)
    second = FallOff(2.0, 12.0, bent, bent, bent)
    mixed = blend(first, second, 0.25)
    assert mixed.valid_radius_mm == 14.25
    assert all(a <= b for a, b in itertools.pairwise((0.0, *mixed.g)))
    for radius in (3.0, 8.0, 12.0):
        expected = 0.75 * loss(first, radius) + 0.25 * loss(second, radius)
        # Beyond 12 mm the second goes on straight, which bends a polynomial a little.
        assert loss(mixed, radius) == pytest.approx(expected, abs=5e-4)


def loss(fall_off: FallOff, radius_mm: float) -> float:
    """-ln I by the definition of the Bernstein polynomial."""
    s = (radius_mm / fall_off.valid_radius_mm) ** 2
    n = len(fall_off.g)
    return sum(
        b * math.comb(n, k) * s**k * (1 - s) ** (n - k)
        for k, b in enumerate(fall_off.g, 1)
    )


def test_a_term_that_one_neighbour_lacks_fades_in():
    full = make_entry().distortion
    bare = msgspec.structs.replace(full, decentering=(), field=None)
    mixed = blend(bare, full, 0.25)
    assert mixed.decentering == pytest.approx((0.25e-4, -0.5e-4, 0, 0))
    assert full.field is not None
    assert mixed.field is not None
    assert mixed.field.degree == 3
    np.testing.assert_allclose(mixed.field.x, 0.25 * np.array(full.field.x))


def test_the_squeeze_takes_the_short_way_round():
    first = msgspec.structs.replace(
        make_entry().distortion, squeeze=2.0, squeeze_axis_rad=math.radians(89)
    )
    second = msgspec.structs.replace(first, squeeze_axis_rad=math.radians(-89))
    mixed = blend(first, second, 0.5)
    assert abs(math.degrees(mixed.squeeze_axis_rad)) == pytest.approx(90)
    assert mixed.squeeze == pytest.approx(2.0, rel=1e-3)


def test_a_squeeze_below_one_is_the_other_axis():
    wide = msgspec.structs.replace(
        make_entry().distortion, squeeze=0.5, squeeze_axis_rad=0.0
    )
    mixed = blend(wide, wide, 0.5)
    assert mixed.squeeze == pytest.approx(2.0)
    assert abs(mixed.squeeze_axis_rad) == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("key", "value"), [("base", "equidistant"), ("reference_radius_mm", 20.0)]
)
def test_different_models_do_not_mix(key: str, value: object):
    first = make_entry()
    other = msgspec.structs.replace(first.distortion, **{key: value})
    second = make_entry(focus_distance_mm=1000.0, distortion=other)
    with pytest.raises(PresetError, match=f"differ in {key}"):
        make_preset(first, second).select(50.0, 2.8, 1500.0)


def test_fields_of_other_degree_mix_and_lack_what_they_lack():
    """States of one lens may need free fields of different degree."""
    first = make_entry()
    richer = blocks.FreeField(4, (0.0,) * 4 + (2e-5,) * 5, (1e-5,) * 9)
    other = msgspec.structs.replace(first.distortion, field=richer)
    second = make_entry(focus_distance_mm=1000.0, distortion=other)
    mixed = blend(first, second, 0.25).distortion.field
    assert mixed is not None
    assert mixed.degree == 4
    small = first.distortion.field
    assert small is not None
    np.testing.assert_allclose(mixed.x[:4], 0.75 * np.array(small.x))
    np.testing.assert_allclose(mixed.x[4:], 0.25 * 2e-5)


def test_fall_off_of_an_unknown_stop_is_used_as_it_is_and_said():
    unknown = msgspec.structs.replace(make_entry().fall_off[0], f_number=None)
    preset = make_preset(make_entry(fall_off=(unknown,)))
    found = preset.select(50.0, 4.0, 2000.0)
    assert found.entry.fall_off == (unknown,)
    assert any("nobody stated" in note for note in found.notes)
    assert preset.select(50.0, None, 2000.0).f_number is None
