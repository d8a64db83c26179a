"""Coverage counts what it says, and a long run can be stopped and goes on."""

import json

import numpy as np
import pytest
from command_line import run
from wrong_usage import told_of_wrong_usage

from data_synth.bench.coverage.benchmark import Subject, bench_coverage, coverage_rows
from data_synth.bench.coverage.predictions import Prediction, Traced
from data_synth.bench.result import Row
from lensfit.errors import DetectionError

PLACES, DRAWS = 40, 100
NOTHING = Traced(50.0, 0.01, (), (), ())


def lines(stated: float, bias: float = 0.0) -> dict[str, Row]:
    """Straight lines fitted to noise of 1: the textbook's deviation times `stated`."""
    rng = np.random.default_rng(0)
    x = np.linspace(-1, 1, PLACES)
    design = np.stack([np.ones(PLACES), x], -1)
    inverse = np.linalg.inv(design.T @ design)
    deviation = stated * np.sqrt(np.einsum("pi,ij,pj->p", design, inverse, design))
    draws = []
    for _ in range(DRAWS):
        value = design @ (inverse @ design.T @ rng.normal(size=PLACES)) + bias
        draws.append({"y_px": Prediction(value, deviation, 0 * x)})
    return {row.what: row for row in coverage_rows("line", draws)}


def test_the_deviation_of_a_least_squares_line_is_honest():
    for row in lines(1.0).values():
        assert 60 < row.value < 76
        assert row.peers["stated"] == pytest.approx(row.peers["found"], rel=0.1)
    assert lines(1.0)["y_px, truth covered, %"].passed


def test_one_that_is_half_as_large_covers_little():
    """Within half a standard deviation lie 38.3 % of a normal distribution."""
    row = lines(0.5)["y_px, truth covered, %"]
    assert row.value == pytest.approx(38.3, abs=6)
    assert row.passed is False


def test_an_error_of_the_model_is_no_scatter():
    rows = lines(1.0, bias=3.0)
    assert 60 < rows["y_px, scatter covered, %"].value < 76
    assert rows["y_px, truth covered, %"].value < 1


def test_a_quantity_without_truth_has_no_row_for_it():
    unknown = np.full(3, np.nan)
    draw = {"defocus_um": Prediction(np.zeros(3), np.ones(3), unknown)}
    found = [row.what for row in coverage_rows("lens", [draw, draw])]
    assert found == ["defocus_um, scatter covered, %"]


def test_what_the_first_draw_lacks_has_its_rows():
    one = Prediction(np.zeros(3), np.ones(3), np.zeros(3))
    found = coverage_rows("lens", [{"red_px": one}, {"red_px": one, "blue_px": one}])
    assert {row.what.split(",")[0] for row in found} == {"red_px", "blue_px"}


def refused(folder, draw, into):
    raise DetectionError(f"draw {draw} is dark")


def test_draws_that_fail_are_told_and_those_that_lie_there_are_kept(tmp_path):
    subject = Subject("lens", lambda folder: NOTHING, refused)
    result = bench_coverage(subject, tmp_path, draws=2)
    assert result["draws"] == 0
    assert [e.split(":")[0] for e in result["errors"]] == ["draw 0", "draw 1"]
    assert json.loads((tmp_path / "bench_coverage.json").read_text()) == result
    one = {"value": [0.1], "deviation": [0.2], "truth": [None]}
    good = {"failed": None, "predicted": {"defocus_um": one}, "seconds": 1.0}
    (tmp_path / "lens" / "draws" / "fastest_0000.json").write_text(json.dumps(good))
    again = bench_coverage(subject, tmp_path, draws=2)
    assert again["draws"] == 1
    assert again["rows"][0]["value"] == 100.0
    # Another subject in the same folder has no part in them.
    other = Subject("other", lambda folder: NOTHING, refused)
    assert bench_coverage(other, tmp_path, draws=2)["draws"] == 0


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--lens", "nosuch"], "--lens nosuch: no prescription named nosuch; bundled"),
        (["--effort", "lazy"], "'lazy' is not one of fastest, fast"),
        (["--size", "12"], "WIDTHxHEIGHT"),
        (["--draws", "1"], "equal to 2"),
    ],
)
def test_wrong_use_is_told_and_exits_with_two(words, says, tmp_path):
    out = str(tmp_path)
    assert says in told_of_wrong_usage("bench", "coverage", "--out", out, *words)


@pytest.mark.hard
def test_draws_of_a_traced_lens(tmp_path):
    words = ["--draws", "2", "--lens", "cooke_triplet_50", "--size", "320x240"]
    words += ["--out", str(tmp_path), "--json"]
    done = run("bench", "coverage", *words)
    assert done.exit_code == 0, done.output
    result = json.loads(done.output)
    rows = {row["what"]: row for row in result["rows"]}
    for name in ("distortion_px", "red_px", "light_percent", "psf_percent"):
        assert rows[f"{name}, truth covered, %"]["value"] > 5
    assert 0 < rows["psf_error_percent, stated, median"]["value"] < 50
