"""A frame wider than what was photographed: a remark, and no picture far beyond it."""

import pytest
from plate_makers import CAMERA, make_preset, write_plate
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.errors import ImageError
from lensfit.preset.scaled_look import spanned_width_note
from lensfit.preset.store import save_preset

RUNNER = CliRunner()


def test_little_is_told_and_much_refused():
    assert spanned_width_note(28.02, 28.0) is None
    assert "the rest is extrapolated" in str(spanned_width_note(28.25, 28.0))
    assert "the rest is extrapolated" in str(spanned_width_note(35.0, 28.0))
    said = "spans 280 mm and .* over 28 mm, which serves up to 35 mm; make sure that"
    with pytest.raises(ImageError, match=said):
        spanned_width_note(280.0, 28.0)


@pytest.mark.parametrize("command", ["apply", "plan", "overscan", "stmap"])
def test_every_command_says_the_same(tmp_path, command):
    preset = tmp_path / "preset.json"
    save_preset(make_preset(), preset)  # photographed over 36 mm
    plate = write_plate(tmp_path / "p.exr", CAMERA)
    words = {
        "apply": [plate, "--out", tmp_path / "out", "--no-defocus"],
        "plan": [plate, "--no-defocus"],
        "overscan": ["--plate", plate],
        "stmap": ["--size", "96x64", "--out", tmp_path / "out"],
    }[command]

    def run(width_mm):
        asked = [command, preset, *words, "--sensor-width-mm", width_mm]
        return RUNNER.invoke(app, [str(word) for word in asked])

    far = run(360)
    assert far.exit_code == 1
    assert "make sure that this is in mm (--sensor-width-mm)" in far.stderr
    assert far.stderr.count("\n") == 1
    assert not list((tmp_path / "out").glob("*"))
    near = run(37)
    assert near.exit_code == 0
    assert near.stderr.count("the rest is extrapolated") == 1
