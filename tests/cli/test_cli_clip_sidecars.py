"""Sidecars of clips on the command line: ``--metadata`` takes them."""

import json

import camera_files as files
import pytest
from command_line import run
from plate_makers import SENSOR, make_preset, write_plate

from lensfit.io.exr import read_exr
from lensfit.preset.store import save_preset


def test_apply_takes_a_clip_of_an_ale(tmp_path):
    save_preset(make_preset(), tmp_path / "preset.json")
    clips = [clip.replace("50", "35") for clip in files.ALE_CLIPS]
    sidecar = files.ale(tmp_path, *clips)
    plate = write_plate(tmp_path / "A001C002.1001.exr", SENSOR)
    words = ("apply", tmp_path / "preset.json", plate, "--out", tmp_path / "out")
    done = run(*words, "--no-defocus", "--metadata", sidecar)
    assert done.exit_code == 0, done.stderr
    (part,) = read_exr(tmp_path / "out" / plate.name).parts
    assert "1498.6 mm focus" in str(part.attributes["lensfit/applied"])
    assert "T-stop" in done.stderr


def test_inspect_shows_what_each_tells(tmp_path):
    plate = write_plate(tmp_path / "p.1001.exr", SENSOR)
    f4, xml = files.mosys(tmp_path, 2.5), files.sony_xml(tmp_path)
    done = run("inspect", plate, "--metadata", f4, "--metadata", xml, "--json")
    assert done.exit_code == 0, done.stderr
    state = json.loads(done.stdout)[0]["state"]
    assert state["focus_distance_mm"] == pytest.approx(2500, rel=1e-6)
    assert state["lens_model"] == "S7i-32"


@pytest.mark.parametrize("make", [files.ale, files.mosys, files.sony_xml])
def test_what_is_cut_short_is_one_line(tmp_path, make):
    path = make(tmp_path)
    path.write_bytes(path.read_bytes()[:20])
    plate = write_plate(tmp_path / "p.exr", SENSOR)
    done = run("inspect", plate, "--metadata", path)
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert str(path) in done.stderr
