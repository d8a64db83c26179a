"""A preset file keeps every bit, reads like a page, and refuses what it should."""

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from preset_makers import make_entry, make_preset

from lensfit.errors import OutputError, PresetError
from lensfit.preset.blocks import Covariance
from lensfit.preset.store import load_preset, save_preset


def test_every_bit_survives_the_file(tmp_path: Path):
    preset = make_preset(make_entry(), make_entry(focus_distance_mm=math.inf))
    save_preset(preset, tmp_path / "p.json")
    assert load_preset(tmp_path / "p.json") == preset


def test_random_numbers_survive_and_are_short(tmp_path: Path):
    numbers = np.random.default_rng(5).normal(size=60).tolist()
    entry = make_entry()
    distortion = type(entry.distortion)(
        "equidistant", 20.0, 1.0, (-1.0, -1.0, 1.0, 1.0), radial_log_slope=(*numbers,)
    )
    save_preset(make_preset(make_entry(distortion=distortion)), tmp_path / "p.json")
    loaded = load_preset(tmp_path / "p.json").entries[0].distortion
    assert loaded.radial_log_slope == tuple(numbers)
    text = (tmp_path / "p.json").read_text()
    assert '"reference_radius_mm": 20.0,' in text


def test_the_file_reads_like_a_page(tmp_path: Path):
    save_preset(
        make_preset(make_entry(focus_distance_mm=math.inf)), tmp_path / "p.json"
    )
    text = (tmp_path / "p.json").read_text()
    assert text.startswith('{\n  "schema": "lensfit.preset.2",\n')
    assert '"focus_distance_mm": "inf"' in text
    assert '"radial_log_slope": [-0.1, 0.3333333333333333, 1e-17]' in text
    assert '"lens": {"name": "SMC Takumar 50/1.4", "serial": "1234567"}' in text
    assert text.endswith("}\n")


def with_change(tmp_path: Path, old: str, new: str) -> Path:
    path = tmp_path / "p.json"
    save_preset(make_preset(), path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"squeeze": 1.9', '"squeeze": "1.9"', "entries[0].distortion.squeeze: expect"),
        (
            '"squeeze": 1.9',
            '"squeeze": -1',
            "entries[0].distortion.squeeze: expected",
        ),
        (
            '"squeeze": 1.9',
            '"squeeze": NaN',
            "entries[0].distortion.squeeze: nan",
        ),
        ('"squeeze": 1.9', '"squeeze": 1e999', "entries[0].distortion.squeeze: inf is"),
        ('"squeeze":', '"squeze":', '"squeze"; did you mean "squeeze"?'),
        ('"rectilinear"', '"recti"', '"recti" is unknown; did you mean "rect'),
        ("51.3", '"inf"', "projection.principal_distance_mm: expected a number"),
        ("[1e-05, 2e-05, ", "[", "distortion.field.x: needs 4 coefficients"),
        ("[-0.8, ", "[0.9, ", "entries[0].distortion.valid_box: is no box"),
        ('"lens":', '"lenses":', 'unknown key "lenses"; did you mean "lens"?'),
        ("preset.2", "preset.7", '"lensfit.preset.7", newer than "lensfit.preset.2"'),
        ("preset.2", "report.1", "so it is no lensfit preset"),
        ('"schema"', '"schemata"', "has no schema, so it is no lensfit preset"),
        ('"f_number": 2.8', '"f_number": 1.4', "fall_off: an f-number stands twice"),
        ("[0.1, 1.0]", "[0.1]", "fall_off[0].r: needs at least one number"),
        ("[0.1, 1.0]", "[1.1, 1.0]", "entries[0].fall_off[0].g: falls somewhere"),
        ('"kept": true', '"kept": true, "kept": true', 'key "kept" stands twice'),
        ("{", "", "is not valid JSON"),
    ],
)
def test_each_fault_names_its_key(tmp_path: Path, old: str, new: str, said: str):
    path = with_change(tmp_path, old, new)
    with pytest.raises(PresetError, match=re.escape(said)) as caught:
        load_preset(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_one_state_twice_is_refused(tmp_path: Path):
    with pytest.raises(PresetError, match=r"entries\[1\].* is entries\[0\] again"):
        save_preset(make_preset(make_entry(), make_entry()), tmp_path / "p.json")


def test_what_is_no_preset(tmp_path: Path):
    with pytest.raises(PresetError, match="cannot be read"):
        load_preset(tmp_path / "none.json")
    for name, content in {"e": b"", "l": b"[1, 2]", "p": b"\x89PNG\r\n"}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(PresetError, match="JSON"):
            load_preset(tmp_path / name)


def test_nothing_unreadable_is_written(tmp_path: Path):
    bad = make_preset(make_entry(focal_length_mm=math.nan))
    with pytest.raises(PresetError, match=r"entries\[0\].focal_length_mm: nan"):
        save_preset(bad, tmp_path / "p.json")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_preset(tmp_path: Path):
    save_preset(make_preset(), tmp_path / "p.json")
    before = (tmp_path / "p.json").read_bytes()
    with pytest.raises(PresetError):
        save_preset(make_preset(make_entry(), make_entry()), tmp_path / "p.json")
    assert (tmp_path / "p.json").read_bytes() == before
    with pytest.raises(OutputError, match="a folder of that name"):
        save_preset(make_preset(), tmp_path)


def test_the_covariance_matrix_survives(tmp_path: Path):
    root = np.random.default_rng(3).normal(size=(6, 6))
    matrix = root @ root.T * 1e-8
    names = tuple("abcdef")
    entry = make_entry(covariance=Covariance.from_matrix(names, matrix))
    save_preset(make_preset(entry), tmp_path / "p.json")
    loaded = load_preset(tmp_path / "p.json").entries[0].covariance
    assert loaded is not None
    np.testing.assert_allclose(loaded.matrix(), matrix, rtol=1e-13)


def test_reading_a_preset_needs_no_jax(tmp_path: Path):
    save_preset(make_preset(), tmp_path / "p.json")
    script = (
        "import sys, lensfit; lensfit.load_preset(sys.argv[1]).select(50.0); "
        "assert 'jax' not in sys.modules"
    )
    path = tmp_path / "p.json"
    subprocess.run([sys.executable, "-c", script, path], check=True)


def test_json_is_plain_json(tmp_path: Path):
    save_preset(make_preset(), tmp_path / "p.json")

    def refuse(constant: str):
        raise AssertionError(constant)

    text = (tmp_path / "p.json").read_text()
    assert json.loads(text, parse_constant=refuse)["schema"] == "lensfit.preset.2"
