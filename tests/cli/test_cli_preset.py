"""`lensfit preset`: what it prints, and how it names faults."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lensfit.cli.main import app

runner = CliRunner()

PRESET = Path(__file__).parent / "tiny_preset.json"


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    path = tmp_path / "broken.json"
    path.write_text(PRESET.read_text().replace('"kept": true', '"kept": "yes"'))
    return path


def test_show_says_which_lens_and_each_entry():
    result = runner.invoke(app, ["preset", "show", str(PRESET)], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    assert "SMC Takumar 50/1.4, serial 1234567" in result.stdout
    assert "50 mm focused at infinity" in result.stdout
    assert "51.3000 mm" in result.stdout


def test_show_as_json_is_the_preset():
    result = runner.invoke(app, ["preset", "show", str(PRESET), "--json"])
    assert json.loads(result.stdout) == json.loads(PRESET.read_text())


def test_validate_names_the_key_and_goes_on(broken: Path):
    result = runner.invoke(app, ["preset", "validate", str(broken), str(PRESET)])
    assert result.exit_code == 1
    assert result.stdout == f"{PRESET}: valid\n"
    assert result.stderr == (
        f"lensfit: error: {broken}: entries[0].terms[0].kept: "
        "expected true or false, got text\n"
    )


def test_validate_as_json_keeps_standard_output_clean(broken: Path):
    result = runner.invoke(
        app, ["preset", "validate", str(broken), str(PRESET), "--json"]
    )
    assert result.exit_code == 1
    faults = json.loads(result.stdout)
    assert faults[str(PRESET)] is None
    assert "terms[0].kept" in faults[str(broken)]


def test_show_of_what_is_no_preset_is_one_line(tmp_path: Path):
    (tmp_path / "p.json").write_text("{}")
    result = runner.invoke(app, ["preset", "show", str(tmp_path / "p.json")])
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert "has no schema, so it is no lensfit preset" in result.stderr
