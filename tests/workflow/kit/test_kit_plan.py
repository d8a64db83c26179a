"""The kit file and its plan: what is refused, what follows, what the crew gets."""

import json
import math
import re
from pathlib import Path

import pytest
from command_line import run
from traced_kit import KIT, write_kit_file

from lensfit.errors import ShootError
from lensfit.workflow.kit.kit_file import load_kit
from lensfit.workflow.kit.kit_plan import kit_plan


def planned(folder: Path, text: str = KIT):
    return kit_plan(load_kit(write_kit_file(folder, text)))


def test_every_stop_at_every_mark_and_a_tilted_view(tmp_path: Path):
    text = KIT.replace("f_numbers = [5.6]", "f_numbers = [2.8, 4.0, 5.6]")
    first, second = planned(tmp_path, text)
    assert len(first.views) == len(second.views) == 3 * 2 + 1
    square = [v for v in first.views if v.tilted is None]
    assert [v.f_number for v in square] == [2.8, 4.0, 5.6] * 2
    # The ring is turned as seldom as can be.
    assert [v.mark for v in square] == ["1.12 m"] * 3 + ["6'"] * 3
    assert {v.target_distance_mm for v in square} == {1120.0}
    (tilted,) = [v for v in first.views if v.tilted]
    assert tilted.target_distance_mm is None
    assert tilted.mark == "1.12 m"
    assert len({v.slate for one in (first, second) for v in one.views}) == 14


def test_marks_are_read_as_engraved(tmp_path: Path):
    text = KIT.replace('"6\'"', '"4\'11\\"", "inf"')
    views = planned(tmp_path, text)[0].views
    found = {v.mark: v.focus_distance_mm for v in views}
    assert found["4'11\""] == pytest.approx(59 * 25.4)
    assert math.isinf(found["inf"])


@pytest.mark.parametrize(
    ("key", "listed", "said"),
    [
        ("focus_marks", '["1.12 m", "6\'", "1.12 m"]', "lists 1.12 m twice"),
        ("focus_marks", '["6\'", "inf", "inf"]', "lists inf twice"),
        (
            "focus_marks",
            '["4\'11\\"", "1.5 m"]',
            "lists 4'11\" and 1.5 m, which are one",
        ),
        (
            "focus_marks",
            '["3\'3\\"", "1 m"]',
            "lists 3'3\" and 1 m, which are one mark",
        ),
        ("f_numbers", "[2.8, 5.6, 2.8]", "lists 2.8 twice"),
    ],
)
def test_a_setting_is_listed_once(tmp_path: Path, key: str, listed: str, said: str):
    held = re.sub(rf"^{key} = .*$", lambda _: f"{key} = {listed}", KIT, flags=re.M)
    with pytest.raises(ShootError, match=re.escape(f"{key} {said}")) as refused:
        planned(tmp_path, held)
    assert "[[lens]] 1 (Wide 28)" in str(refused.value)
    assert refused.value.remedy == "keep one of them"


def test_marks_as_near_as_barrels_have_them_are_two(tmp_path: Path):
    marks = """focus_marks = ["8'", "8'1\\"", "20 m", "30 m", "inf"]"""
    text = re.sub(r"^focus_marks = .*$", lambda _: marks, KIT, flags=re.M)
    assert len(planned(tmp_path, text)[0].views) == 5 + 1


def test_light_goes_as_the_square_of_n_times_one_plus_m(tmp_path: Path):
    """Two stops are a factor of four; at infinity the metered time holds as it is."""
    text = KIT.replace("f_numbers = [5.6]", "f_numbers = [2.8, 5.6]")
    text = text.replace('"6\'"', '"inf"')
    views = planned(tmp_path, text)[0].views
    near_wide, near_closed, far_wide, _ = views[:4]
    assert near_closed.shutter_s == pytest.approx(4 * near_wide.shutter_s)
    assert near_closed.exposure_stops == pytest.approx(2.0)
    assert far_wide.shutter_s == pytest.approx(0.02, rel=1e-4)
    focal, conjugates = 28.0, 1120.0
    away = (conjugates + math.sqrt(conjugates**2 - 4 * focal * conjugates)) / 2
    gain = (1 + focal / (away - focal)) ** 2
    assert near_wide.shutter_s == pytest.approx(0.02 * gain, rel=1e-6)


def test_time_is_lenses_views_and_exposures(tmp_path: Path):
    text = KIT + "[pace]\nper_view_s = 50\nper_lens_s = 100\n"
    plan = planned(tmp_path, text)[0]
    exposures = sum(view.shutter_s for view in plan.views)
    assert plan.seconds == pytest.approx(100 + 3 * 50 + exposures)


def test_a_chart_of_known_size_says_where_it_stands(tmp_path: Path):
    text = KIT.replace('target_distance = "1.12 m"\n', "")
    with pytest.raises(ShootError, match="does not say where the chart stands"):
        planned(tmp_path / "a", text)
    marks = text.replace('kind = "dot-grid"', 'kind = "dot-grid"\nmarks = [21, 15]')
    wide, normal = planned(tmp_path / "b", marks)
    # 20 pitches of 60 mm across 28 mm; height 14 x 60 across 21: the height decides.
    for plan, focal in ((wide, 28.0), (normal, 35.0)):
        m = 28.0 / (20 * 60.0)
        expected = focal * (2 + m + 1 / m)
        assert plan.target_distance_mm[0] == pytest.approx(expected, rel=0.1)
    ratio = normal.target_distance_mm[0] / wide.target_distance_mm[0]
    assert ratio == pytest.approx(35 / 28, rel=0.01)


def test_overlapping_dots_are_foreseen(tmp_path: Path):
    text = KIT.replace("f_numbers = [5.6]", "f_numbers = [1.4, 5.6]")
    text = text.replace("pitch_mm = 60.0", "pitch_mm = 8.0")
    plan = planned(tmp_path, text)[0]
    assert any(view.overlapping for view in plan.views)
    assert "run into each other" in plan.notes[0]
    assert not any(v.overlapping for v in planned(tmp_path / "wide")[0].views)


def test_a_zoom_is_photographed_at_each_focal_length(tmp_path: Path):
    text = KIT.replace("focal_length_mm = 28.0", "focal_lengths_mm = [24.0, 50.0]")
    views = planned(tmp_path, text)[0].views
    assert [v.focal_length_mm for v in views] == [24.0] * 3 + [50.0] * 3


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('serial = "102"', "seriel = 2", 'unknown key "seriel"; did you mean "serial"'),
        ('"6\'"]', "1828]", "focus mark 1828 names no unit"),
        ('"1.12 m"\ntilted', '"112"\ntilted', "is no length"),
        ('name = "Wide 35"', 'name = "Wide 28"', 'has the folder "same" of another'),
        ("focal_length_mm = 35.0", "focal_length_mm = 350.0", "is nearer than a lens"),
        ("focal_length_mm = 35.0", "focal_length_mm = 0.035", "too short"),
        ('encoding = "linear"', 'encoding = "liner"', 'did you mean "linear"?'),
        ('serial = "102"', 'folder = "../x"', "leaves the folder of the kit file"),
        ('serial = "102"', 'target = "dots"', 'no target is named "dots"'),
        ("[exposure]", "[exposure", "is not valid TOML"),
        ("image_size_px = [400, 300]", "image_size_px = [0, 0]", "image_size_px"),
    ],
)
def test_what_is_wrong_is_one_line_that_names_it(tmp_path, old: str, new, said: str):
    text = KIT.replace(old, new)
    if "same" in said:
        text = text.replace('serial = "101"', 'folder = "same"')
        text = text.replace('serial = "102"', 'folder = "Same"')
        said = said.replace('"same"', '"Same"')
    path = write_kit_file(tmp_path, text)
    result = run("kit", "plan", path)
    assert result.exit_code == 1
    assert said in result.stderr
    assert result.stderr.count("\n") == 1
    assert str(path) in result.stderr


def test_the_list_the_json_and_the_paper_say_the_same(tmp_path: Path):
    path, paper = write_kit_file(tmp_path), tmp_path / "takes.html"
    lines = run("kit", "plan", path, "--out", paper).stdout
    told = json.loads(run("kit", "plan", path, "--json").stdout)
    assert told["views"] == 6
    page = paper.read_text()
    for lens in told["lenses"]:
        for view in lens["views"]:
            assert view["slate"] in lines
            assert page.count(view["slate"]) == 1
    assert page.count("☐") == 6
    assert "2 lenses, 6 views, about" in lines


def test_a_folder_without_photographs_misses_every_view(tmp_path: Path):
    path = write_kit_file(tmp_path)
    result = run("kit", "check", path)
    assert result.exit_code == 1
    assert "wide-28_101: Wide 28 s/n 101, 0 of 3 views; missing: " in result.stdout


def test_the_farm_job_is_read_by_open_job_description(tmp_path: Path):
    from openjd.model import decode_job_template

    path = write_kit_file(tmp_path)
    out = tmp_path / "out"
    result = run("kit", "submit", path, "--out", out)
    assert result.exit_code == 0, result.stderr
    table = json.loads((out / "kit.openjd.json").read_text())
    template = decode_job_template(template=table)
    calibrate, page = template.steps
    assert [
        str(one)
        for one in table["steps"][0]["parameterSpace"]["taskParameterDefinitions"][0][
            "range"
        ]
    ] == ["wide-28_101", "wide-35_102"]
    assert page.dependencies[0].dependsOn == calibrate.name
    values = json.loads((out / "kit.openjd.parameters.json").read_text())
    assert values == {"KitFolder": str(tmp_path), "Out": str(out)}
