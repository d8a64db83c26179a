"""Settings files: the nearest counts, key by key, and slips are named."""

import math
import pickle

import pytest

from lensfit.errors import SettingsError
from lensfit.io.camera.header_entries import Alias
from lensfit.plate.camera.settings import NAME, load_settings, settings_beside


def written(folder, text, name=NAME):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def value(settings, name, frame=None):
    """The word that counts most, as a source among several reads it."""
    return next((r.value for n, r in settings.camera_at(frame) if n == name), None)


def test_the_nearest_file_counts_key_by_key(tmp_path):
    shot = tmp_path / "seq" / "shot"
    written(
        tmp_path,
        '[camera]\nf_number = 2.0\nsensor_width_mm = 36\n[aliases]\nf_number = "a/n"\n'
        "[knobs]\ncoma_gain = 2.0\nfringe = 1\n",
    )
    written(shot.parent, '[camera]\nf_number = 2.8\n[aliases]\nf_number = "b/n"\n')
    written(shot, "[camera]\nfocal_length_mm = 50\n[knobs]\ncoma_gain = 0.5\n")
    found = settings_beside(shot)
    names = ("focal_length_mm", "f_number", "sensor_width_mm", "focus_distance_mm")
    assert [value(found, n) for n in names] == [50, 2.8, 36, None]
    assert found.knobs == {"coma_gain": 0.5, "fringe": 1}
    assert found.knob_paths == {"coma_gain": shot / NAME, "fringe": tmp_path / NAME}
    assert found.aliases == {"f_number": (Alias("b/n"),)}
    assert found.paths[:3] == (shot / NAME, shot.parent / NAME, tmp_path / NAME)
    assert pickle.loads(pickle.dumps(found)) == found


def test_no_file_is_no_settings(tmp_path):
    found = settings_beside(tmp_path / "nowhere")
    assert list(found.camera_at(1)) == []
    assert found.paths == ()


def test_an_edited_file_is_read_again(tmp_path):
    written(tmp_path, "[camera]\nf_number = 2.0\n")
    assert value(settings_beside(tmp_path), "f_number") == 2.0
    written(tmp_path, "[camera]\nf_number = 11.25\n")
    assert value(settings_beside(tmp_path), "f_number") == 11.25


def test_frames_count_more_than_camera_and_the_last_most(tmp_path):
    text = """
        [camera]
        f_number = 2.0
        [[frames]]
        range = "1001-1010x2,1020"
        f_number = 4
        [[frames]]
        range = "1005"
        f_number = 8
    """
    found = load_settings(written(tmp_path, text))
    wanted = {1000: 2, 1001: 4, 1002: 2, 1003: 4, 1005: 8, 1020: 4, None: 2}
    assert {f: value(found, "f_number", f) for f in wanted} == wanted
    (first, *_) = (r for n, r in found.camera_at(1005))
    assert first.entry.endswith("[[frames]] 2")


def test_pulls_go_linearly_and_focus_in_dioptres(tmp_path):
    text = """
        [[frames]]
        at = [1001, 1011, 1021, 1031, 1100]
        focal_length_mm = [50, 50, 60, 60, 60]
        focus_distance_mm = [1000, 1000, 4000, inf, inf]
        f_number = 2.8
    """
    found = load_settings(written(tmp_path, text))
    zoom = {1001: 50, 1011: 50, 1016: 55, 1021: 60, 1100: 60, 1101: None}
    assert {f: value(found, "focal_length_mm", f) for f in zoom} == zoom
    # Half way between 1 and 1/4 dioptre is 5/8; half way to infinity doubles.
    assert value(found, "focus_distance_mm", 1016) == pytest.approx(1600)
    assert value(found, "focus_distance_mm", 1026) == pytest.approx(8000)
    assert value(found, "focus_distance_mm", 1031) == math.inf
    assert value(found, "f_number", 1031) == 2.8


def test_without_a_range_keys_span_it(tmp_path):
    text = "[[frames]]\nat = [5, 9]\nf_number = [2, 4]\n"
    found = load_settings(written(tmp_path, text))
    assert [value(found, "f_number", f) for f in (4, 5, 7, 9, 10)] == [
        None,
        2,
        3,
        4,
        None,
    ]


def test_aliases_have_units_and_factors(tmp_path):
    text = """
        [aliases]
        focal_length_mm = ["a/f", {key = "b/f", unit = "cm"}]
        focus_distance_mm = {key = "a/focus", factor = 304.8}
        lens_model = "a/lens"
    """
    assert load_settings(written(tmp_path, text)).aliases == {
        "focal_length_mm": (Alias("a/f"), Alias("b/f", 10.0)),
        "focus_distance_mm": (Alias("a/focus", 304.8),),
        "lens_model": (Alias("a/lens"),),
    }


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[camra]", 'unknown key "camra"; did you mean "camera"'),
        ("[camera]\nfocal_lenght_mm = 5", 'did you mean "focal_length_mm"'),
        ("[camera]\nf_number = 'wide'", "a number"),
        ("[camera]\nf_number = 0", "f_number is 0"),
        ("[camera]\nf_number = -2", "f_number is -2"),
        ("[camera]\nf_number = nan", "f_number is nan"),
        ("[camera]\nfocal_length_mm = inf", "focal_length_mm is inf"),
        ("[camera]\nsensor_width_mm = 1e30", "sensor_width_mm is 1e\\+30"),
        ("[[frames]]\nf_number = 2", "has no frames"),
        ("[[frames]]\nrange = 'all'\nf_number = 2", "no range of frames"),
        ("[[frames]]\nrange = '1-2x0'\nf_number = 2", "no range of frames"),
        ("[[frames]]\nrange = '1-2'\nf_number = [2]", "at has 0 frames"),
        ("[[frames]]\nat = [1, 2]\nf_number = [2]", "1 values and at has 2"),
        ("[[frames]]\nat = [2, 1]\nf_number = [2, 3]", "rising"),
        ("[[frames]]\nat = []\nf_number = 2", "rising"),
        ("[[frames]]\nrange = '1'\nat = 5", r"\[\[frames\]\] 1, at"),
        ("[[frames]]\nrange = '1-9'\nat = [2, 4]\nf_number = [2, 4]", "1 has both"),
        ("[aliases]\nfocal_length = 'a'", 'did you mean "focal_length_mm"'),
        ("[aliases]\nf_number = {key = 'a', unit = 'mm'}", "no unit"),
        ("[aliases]\nfocal_length_mm = {key = 'a', unit = 'ell'}", "no unit"),
        ("[aliases]\nf_number = {key = 'a', factor = 0}", "above zero"),
        ("[aliases]\nf_number = ''", "no name"),
        ("[camera\n", "not valid TOML"),
        ("a" + ".a" * 9999 + " = 1", "dots"),
        ("a = " + "[" * 99_999, "not valid TOML"),
        ("[camera]\nf_number = " + "9" * 9999, "not valid TOML"),
    ],
)
def test_slips_are_named(tmp_path, text, said):
    path = written(tmp_path, text)
    with pytest.raises(SettingsError, match=said) as caught:
        load_settings(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "name", "remedy"),
    [
        ("[[frames]]\nrange = '1-9'\nat = [2, 4]", "[[frames]] 1", "leave range out"),
        ("[[frames]]\nat = [2, 1]\nf_number = [2, 3]", "at must", "[1001, 1020"),
        ("[aliases]\nfocal_length = 'a/b'", '"focal_length"', '"myrenderer/focal"'),
        ("[aliases]\nf_number = ''", "[aliases] f_number", "name the header entry"),
        ("[aliases]\nf_number = {key = 'a/n', unit = 'mm'}", '"a/n"', "leave the unit"),
        ("[aliases]\nfocal_length_mm = {key = 'a/f', unit = 'ell'}", '"a/f"', "mm, cm"),
        ("[aliases]\nf_number = {key = 'a/n', factor = 0}", '"a/n"', "multiplied by"),
        (
            "[aliases]\nfocal_length_mm = {key = 'a/f', unit = 'cm', factor = 2}",
            '"a/f"',
            "leave one",
        ),
        ("[aliases]\nlens_model = {key = 'a/m', factor = 2}", '"a/m"', "leave them"),
    ],
)
def test_slips_name_the_entry_and_what_to_do(tmp_path, text, name, remedy):
    with pytest.raises(SettingsError) as caught:
        load_settings(written(tmp_path, text))
    assert name in caught.value.what
    assert remedy in (caught.value.remedy or "")


@pytest.mark.parametrize("data", [b"\xff\xfe[", b"\0", b"a" * (2 << 20)])
def test_what_is_no_text_is_refused(tmp_path, data):
    path = tmp_path / NAME
    path.write_bytes(data)
    with pytest.raises(SettingsError, match=NAME):
        load_settings(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(SettingsError, match="cannot be read"):
        load_settings(tmp_path / "none.toml")
