"""Knobs have one name everywhere, and say plainly what they cannot be set to."""

import msgspec
import pytest
from preset_makers import make_preset

from lensfit.errors import PresetError
from lensfit.preset.knobs import (
    GROUP_OF,
    NEUTRAL,
    Knobs,
    active_knobs,
    adjusted_knobs,
    knob_entries,
    misspelt_knob_notes,
)
from lensfit.preset.store import load_preset, save_preset


def test_every_name_stands_in_one_group():
    groups = [getattr(NEUTRAL, g).__struct_fields__ for g in Knobs.__struct_fields__]
    assert sum(map(len, groups)) == len(GROUP_OF)


def test_every_knob_says_what_it_is_and_where_it_ends():
    for group in Knobs.__struct_fields__:
        schema = msgspec.json.schema(type(getattr(NEUTRAL, group)))
        for record in schema["$defs"].values():
            for name, knob in record["properties"].items():
                kinds = knob.get("anyOf", [knob])
                assert any("description" in kind for kind in kinds), name
                for kind in kinds:
                    if kind.get("type") in ("number", "integer"):
                        assert {"minimum", "maximum"} <= set(kind), name


def test_the_last_word_counts_and_text_is_a_number():
    once = adjusted_knobs(NEUTRAL, {"coma_gain": "0.5", "blades": "7"})
    twice = adjusted_knobs(once, {"coma_gain": 2})
    assert active_knobs(twice) == {"coma_gain": 2.0, "blades": 7}
    assert active_knobs(adjusted_knobs(twice, {"coma_gain": 1.0, "blades": None})) == {}


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"coma_gan": 1}, 'no knob "coma_gan"; did you mean "coma_gain"?'),
        ({"blades": "many"}, "whole number"),
        ({"blades": 99}, "at most 16"),
        ({"blades": "1"}, "blades is 1; an aperture has no blades (0) or at least 3"),
        ({"blades": 2}, "blades is 2; an aperture has no blades (0) or at least 3"),
        ({"coma_gain": "nan"}, "no finite number"),
        ({"coma_gain": float("nan")}, "no finite number"),
        ({"coma_gain": "1e999"}, "no finite number"),
        ({"coma_gain": [1]}, "expected a number, got a list"),
    ],
)
def test_what_cannot_be_set_is_said(values, said):
    with pytest.raises(PresetError, match="knobs: ") as caught:
        adjusted_knobs(NEUTRAL, values)
    assert said in str(caught.value)


def test_a_header_may_have_any_prefix_and_other_entries():
    attributes = {
        "exr/lensfit/coma_gain": "2",
        "lensfit/blades": 5,
        "otherlensfit/blades": 3,
        "lensfit/applied": "said",
    }
    assert knob_entries(attributes) == [
        ("exr/lensfit/coma_gain", "coma_gain", "2"),
        ("lensfit/blades", "blades", 5),
    ]
    assert misspelt_knob_notes(attributes) == ()


@pytest.mark.parametrize(
    "name", ["bloom_gian", "bloom-gain", "Bloom_gain", "bloomgain"]
)
def test_a_slip_in_a_header_is_told_and_lensfits_own_entries_are_none(name):
    own = ("applied", "map", "lens", "version", "undefinedUV")
    assert misspelt_knob_notes({f"lensfit/{n}": 1 for n in own}) == ()
    (slip,) = misspelt_knob_notes({f"exr/lensfit/{name}": 0.2, f"other{name}": 0.2})
    assert f'"lensfit/{name}" is no knob' in slip
    assert 'did you mean "bloom_gain"?' in slip


def test_a_preset_keeps_its_knobs(tmp_path):
    knobs = adjusted_knobs(NEUTRAL, {"coma_gain": 0.25})
    preset = msgspec.structs.replace(make_preset(), knobs=knobs)
    save_preset(preset, tmp_path / "preset.json")
    assert '"coma_gain": 0.25' in (tmp_path / "preset.json").read_text()
    assert load_preset(tmp_path / "preset.json") == preset


def test_a_preset_with_two_blades_is_refused_by_name(tmp_path):
    path = tmp_path / "preset.json"
    save_preset(
        msgspec.structs.replace(
            make_preset(), knobs=adjusted_knobs(NEUTRAL, {"blades": 3})
        ),
        path,
    )
    assert load_preset(path).knobs.bokeh.blades == 3
    path.write_text(path.read_text().replace('"blades": 3', '"blades": 2'))
    with pytest.raises(PresetError, match="blades is 2; an aperture") as caught:
        load_preset(path)
    assert caught.value.where == path
