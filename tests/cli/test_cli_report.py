"""`lensfit report`: the table and page of a finished calibration."""

import json
from pathlib import Path

import pytest
from command_line import run

from lensfit.report.report_page import read_report

REPORT = {
    "schema": "lensfit.report.2",
    "lens": {"name": "50/1.4"},
    "rms_px": 0.0212,
    "held_out_rms_px": 0.0234,
    "points_detected": 1900,
    "points_used": 1890,
    "takes": [
        {
            "image": "a.exr",
            "points_detected": 1000,
            "points_used": 995,
            "rms_px": 0.02,
            "held_out_rms_px": 0.022,
        },
        {"image": "b.exr", "failed": "b.exr: no grid was found"},
    ],
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "report.json").write_text(json.dumps(REPORT))
    return tmp_path


@pytest.mark.parametrize("name", ["", "report.json"])
def test_report_prints_the_errors_and_writes_the_page(folder: Path, name: str):
    result = run("report", folder / name, env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.stderr
    assert "0.0234" in result.stdout
    assert "a.exr" in result.stdout
    assert (folder / "report.html").read_text().startswith("<!")


def test_report_as_json_is_the_report_and_writes_nothing(folder: Path):
    result = run("report", folder, "--json")
    said = json.loads(result.stdout)
    judged = said.pop("verdict")
    assert said == REPORT
    assert judged["level"] == "undistortion"
    assert not (folder / "report.html").exists()


def test_a_report_of_the_first_schema_is_read_in_the_words_of_this_one(tmp_path: Path):
    said = {"takes": [], "statements": [{"quantity": "usual_pupil_walk"}]}
    old = {"schema": "lensfit.report.1", "blur": [{"guessed": ["at f/2"]}], **said}
    path = tmp_path / "report.json"
    path.write_text(json.dumps(old))
    found = read_report(path)
    assert found["schema"] == REPORT["schema"]
    assert found["blur"] == [{"extrapolated": ["at f/2"]}]
    assert found["statements"] == [{"quantity": "usual_pupil_shift"}]


@pytest.mark.parametrize(("level", "code"), [("undistortion", 0), ("measurement", 1)])
@pytest.mark.parametrize("options", [[], ["--json"]])
def test_a_verdict_below_the_required_one_exits_1(folder: Path, level, code, options):
    command = ["report", str(folder), "--require", level, *options]
    result = run(*command)
    assert result.exit_code == code
    assert ("below measurement" in result.stderr) == bool(code)


def test_terminal_page_and_json_say_the_same(folder: Path):
    said = run("report", folder, "--json").stdout
    judged = json.loads(said)["verdict"]
    printed = run("report", folder).stdout.splitlines()
    page = (folder / "report.html").read_text()
    assert printed[0] == judged["headline"]
    for reason in judged["reasons"]:
        assert reason["text"] in printed
        assert reason["text"] in page
    assert f'data-level="{judged["level"]}"' in page


def test_a_level_that_is_none_is_wrong_usage(folder: Path):
    result = run("report", folder, "--require", "perfect")
    assert result.exit_code == 2


@pytest.mark.parametrize("content", [None, "", "[]", '{"schema": "lensfit.preset.2"}'])
def test_what_is_no_report_is_one_line(tmp_path: Path, content: str | None):
    if content is not None:
        (tmp_path / "report.json").write_text(content)
    result = run("report", tmp_path)
    assert result.exit_code == 1
    assert result.stderr.startswith(f"lensfit: error: {tmp_path}")
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "report.html").exists()
