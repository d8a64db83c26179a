"""`lensfit chart` from the command line: files, advice, and refusals in one line."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lensfit.cli.main import app


def run(*arguments: str):
    return CliRunner().invoke(app, ["chart", *arguments])


def test_every_format_is_written(tmp_path: Path):
    files = [
        str(tmp_path / f"chart.{end}") for end in ("svg", "pdf", "png", "exr", "dxf")
    ]
    options = [word for file in files for word in ("--out", file)]
    result = run("--paper", "A4", "--dpi", "72", *options, "--json")
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout)
    assert said["files"] == files
    assert said["pattern"]["pitch_mm"] == 10.0
    starts = [Path(file).read_bytes()[:4] for file in files]
    assert starts == [b"<?xm", b"%PDF", b"\x89PNG", b"v/1\x01", b"999\n"]


def test_a_screen_is_filled_pixel_by_pixel(tmp_path: Path):
    from lensfit.io.image import read_photograph

    out = tmp_path / "screen.exr"
    options = ("--screen", "1280x720", "--pixel-pitch-mm", "0.3", "--out", str(out))
    assert run("--kind", "line-grid", *options).exit_code == 0
    assert read_photograph(out).size_px == (1280, 720)


def test_advice_is_told_and_printed_for_machines():
    lens = ("--focal-length-mm", "50", "--f-number", "1.4", "--sensor-width-mm", "24.9")
    told = run("advise", *lens)
    assert told.exit_code == 0, told.output
    assert "from the sensor" in told.stdout
    said = json.loads(run("advise", *lens, "--paper", "A2", "--json").stdout)
    assert said["sheet_mm"] == [594.0, 420.0]
    assert len(said["takes"]) == 6


@pytest.mark.parametrize(
    "options",
    [
        ("--paper", "A9"),
        ("--pitch-mm", "nan"),
        ("--pitch-mm", "0"),
        ("--pitch-mm", "900"),
        ("--hole-diameter-mm", "0"),
        ("--line-width-mm", "2"),
        ("--screen", "1920x1080"),
        ("--paper", "A0", "--dpi", "600"),
        ("--margin-mm", "-1"),
        ("--kind", "checkerboard", "--polarity", "bright"),
    ],
)
def test_what_cannot_be_made_is_one_line(options: tuple[str, ...], tmp_path: Path):
    result = run(*options, "--out", str(tmp_path / "x.png"))
    assert result.exit_code == 1
    assert result.stderr.startswith("lensfit: error: ")
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "x.png").exists()


@pytest.mark.parametrize("option", ["--pitch-mm", "--hole-diameter-mm"])
def test_a_length_out_of_range_is_named(option: str, tmp_path: Path):
    result = run(option, "0", "--out", str(tmp_path / "x.png"))
    assert f"{option} 0 is out of range; give 0.0" in result.stderr


def test_no_file_is_wrong_usage_and_no_format_an_error(tmp_path: Path):
    assert run().exit_code == 2
    assert run("--out", str(tmp_path / "x.gif")).exit_code == 1
