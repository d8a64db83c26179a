"""Knobs: every source's word, which counts, and bad ones in one line with a remedy."""

import json

import msgspec
import pytest
from command_line import run
from plate_makers import CAMERA, SENSOR, make_preset, write_plate

from lensfit.errors import ImageError, PresetError, SettingsError
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.plate_camera import KnobWord, knobs_of_plate
from lensfit.plate.camera.settings import Settings, load_settings
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.plate_file import plate_header
from lensfit.preset.knobs import NEUTRAL, adjusted_knobs
from lensfit.preset.store import save_preset

ALL = {**CAMERA, **SENSOR}


def inspected(*words):
    result = run("inspect", *words, "--json")
    return result, json.loads(result.stdout)[0]


def test_each_source_is_overruled_by_the_one_before_it(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text("[knobs]\ncoma_gain = 0.5\n")
    preset = adjusted_knobs(NEUTRAL, {"coma_gain": 3.0, "blades": 6})
    header = {"exr/lensfit/coma_gain": "0.25"}
    found = knobs_of_plate(preset, header, load_settings(path), {"coma_gain": 2.0})
    assert found.known["coma_gain"] == KnobWord(2.0, "--coma-gain")
    assert found.overruled["coma_gain"] == (
        KnobWord(0.5, f"{path} [knobs]"),
        KnobWord(0.25, "exr/lensfit/coma_gain"),
        KnobWord(3.0, "preset"),
    )
    assert found.known["blades"] == KnobWord(6, "preset")
    assert found.checked().aberration.coma_gain == 2
    assert found.checked().bokeh.blades == 6


def test_a_bad_word_hurts_only_where_it_counts(tmp_path):
    header = {"lensfit/coma_gain": "much"}
    found = knobs_of_plate(NEUTRAL, header, Settings(), {})
    with pytest.raises(ImageError, match="header entry 'lensfit/coma_gain'") as caught:
        found.checked()
    assert caught.value.remedy == "mend it, or give --coma-gain"
    stated = knobs_of_plate(NEUTRAL, header, Settings(), {"coma_gain": 0.5})
    assert stated.checked().aberration.coma_gain == 0.5
    path = tmp_path / "s.toml"
    path.write_text("[knobs]\nblades = -1\n")
    with pytest.raises(SettingsError, match="or give --blades"):
        knobs_of_plate(NEUTRAL, {}, load_settings(path), {}).checked()


@pytest.mark.parametrize("blades", [1, 2])
def test_too_few_blades_are_refused_wherever_they_are_stated(blades, tmp_path):
    said = f"blades is {blades}; an aperture has no blades .0. or at least 3"
    with pytest.raises(ImageError, match=said):
        knobs_of_plate(NEUTRAL, {"lensfit/blades": blades}, Settings(), {}).checked()
    with pytest.raises(PresetError, match=said):
        knobs_of_plate(NEUTRAL, {}, Settings(), {"blades": blades}).checked()
    path = tmp_path / "s.toml"
    path.write_text(f"[knobs]\nblades = {blades}\n")
    with pytest.raises(SettingsError, match=said):
        knobs_of_plate(NEUTRAL, {}, load_settings(path), {}).checked()


def test_the_frame_of_a_bad_knob_is_named(tmp_path):
    plate = write_plate(tmp_path / "p.exr", {**ALL, "lensfit/coma_gain": "much"})
    lens = PlateLens(make_preset(), ApplyOptions())
    with pytest.raises(Exception, match=f"^{plate}: header entry 'lensfit/coma_gain'"):
        lens.state_of(plate_header(plate), plate)


def test_a_header_that_contradicts_itself_is_told():
    header = {"lensfit/coma_gain": 0.5, "exr/lensfit/coma_gain": "2"}
    found = knobs_of_plate(NEUTRAL, header, Settings(), {})
    ((name, said),) = found.notes
    assert name == "coma_gain"
    assert "lensfit/coma_gain (0.5) is used, not exr/lensfit/coma_gain (2.0)" in said
    assert knobs_of_plate(NEUTRAL, header, Settings(), {"coma_gain": 1.0}).notes == ()


def test_inspect_shows_knobs_with_their_sources(tmp_path):
    (tmp_path / "lensfit.toml").write_text("[knobs]\ncoma_gain = 0.5\n")
    plate = write_plate(
        tmp_path / "p.exr",
        {**ALL, "lensfit/coma_gain": "0.25", "lensfit/bloom_gain": 0.125},
    )
    _, record = inspected(plate)
    assert record["knobs"] == {
        "coma_gain": {"value": 0.5, "source": f"{tmp_path / 'lensfit.toml'} [knobs]"},
        "bloom_gain": {"value": 0.125, "source": "lensfit/bloom_gain"},
    }
    (other,) = record["overruled"]["coma_gain"]
    assert other == {"value": 0.25, "source": "lensfit/coma_gain"}
    preset = msgspec.structs.replace(
        make_preset(), knobs=adjusted_knobs(NEUTRAL, {"bloom_gain": 0.3, "blades": 7})
    )
    save_preset(preset, tmp_path / "preset.json")
    _, record = inspected(plate, "--preset", tmp_path / "preset.json")
    assert record["knobs"]["blades"] == {"value": 7, "source": "preset"}
    assert record["overruled"]["bloom_gain"] == [{"value": 0.3, "source": "preset"}]
    text = run("inspect", plate).stdout
    assert "knob coma_gain" in text


@pytest.mark.parametrize(
    ("entry", "settings", "said"),
    [
        ({"lensfit/coma_gain": "much"}, "", "header entry 'lensfit/coma_gain'"),
        ({}, "coma_gain = 'much'", "--coma-gain"),
        ({}, "coma_gian = 1", 'did you mean "coma_gain"'),
    ],
)
def test_inspect_reports_a_bad_knob_and_shows_the_rest(tmp_path, entry, settings, said):
    (tmp_path / "lensfit.toml").write_text(f"[knobs]\n{settings}\n")
    plate = write_plate(tmp_path / "p.exr", {**ALL, **entry, "lensfit/blades": 5})
    result, record = inspected(plate)
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"lensfit: error: {plate}: ")
    assert said in line
    assert record["state"]["focal_length_mm"] == 35
    assert record["knobs"]["blades"]["value"] == 5


def test_inspect_tells_a_slip(tmp_path):
    plate = write_plate(tmp_path / "p.exr", {**ALL, "lensfit/coma_gian": 0.5})
    result, _ = inspected(plate)
    assert 'did you mean "coma_gain"' in result.stderr
