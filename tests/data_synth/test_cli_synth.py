"""`lensfit synth`, as it is typed."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner
from wrong_usage import told_of_wrong_usage

from data_synth.plan import planned_shots
from data_synth.prescription import load_prescription, prescription_names
from data_synth.sensor import Frame
from lensfit.cli.main import app
from lensfit.io.exr import read_exr
from lensfit.workflow.shoot.shoot_file import load_shoot


def run(*words: str):
    return CliRunner().invoke(app, ["synth", *words])


def test_list_names_every_bundled_lens():
    listed = json.loads(run("--list", "--json").stdout)
    assert [row["name"] for row in listed] == prescription_names()
    plain = run("--list").stdout
    assert all(name in plain for name in prescription_names())


def test_a_shoot_is_written_that_calibrate_can_read(tmp_path):
    done = run("petzval_50", "--out", str(tmp_path), "--size", "64x48", "--json")
    assert done.exit_code == 0, done.output
    shoot = load_shoot(tmp_path / "shoot.toml")
    assert [take.f_number for take in shoot.takes] == [4.0, 4.0]
    part = read_exr(tmp_path / shoot.takes[0].image).parts[0]
    assert part.channels["G"].shape == (48, 64)
    assert part.channels["G"].dtype == np.float16


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["nosuch"], "no prescription named nosuch"),
        ([], "name a lens"),
        (["petzval_50", "--f-number", "1"], "opens to 2"),
        (["petzval_50", "--size", "12"], "WIDTHxHEIGHT"),
        (["petzval_50", "--focus", "20"], "ten focal lengths"),
        (["petzval_50", "--target", "stars"], "not one of"),
        (["petzval_50", "--wavefront", "--focus", "900"], "chooses --focus"),
        (["petzval_50", "--wavefront", "--size", "9x9"], "WIDTHxHEIGHT"),
    ],
)
def test_wrong_use_is_told_and_exits_with_two(words, says, tmp_path):
    out = tmp_path / "never"
    assert says in told_of_wrong_usage("synth", *words, "--out", str(out))
    assert not out.exists()


@pytest.mark.slow
def test_a_wavefront_shoot_is_written_with_its_true_spots(tmp_path):
    words = ("--wavefront", "--f-number", "8", "--format", "png16", "--json")
    done = run("cooke_triplet_50", *words, "--size", "96x72", "--out", str(tmp_path))
    assert done.exit_code == 0, done.output
    assert "dots_f8_near" in json.loads(done.stdout)["takes"]
    assert {t.f_number for t in load_shoot(tmp_path / "shoot.toml").takes} == {8, 16}
    assert (tmp_path / "truth_wavefront.npz").is_file()


@pytest.mark.parametrize("name", prescription_names())
def test_planned_marks_are_a_few_pixels_wide(name):
    prescription = load_prescription(name)
    frame = Frame((1280, 960), prescription.sensor_size_mm)
    shots = planned_shots(prescription, frame)
    assert len(shots) == 2 * len(prescription.states)
    for shot in shots:
        assert 0.05 < shot.chart.mark_mm / shot.chart.pitch_mm < 0.12
