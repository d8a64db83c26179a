"""The wavefront benchmark keeps going, and says why a lens failed."""

import json

import numpy as np
import pytest
from wrong_usage import told_of_wrong_usage

from data_synth.bench.wavefront.benchmark import Trial, bench_wavefront
from data_synth.bench.wavefront.beside import Beside
from data_synth.commands.bench.wavefront import judged, trials_of, wavefront_table
from data_synth.judge import judge
from data_synth.judge_spots import judge_spots
from data_synth.wavefront_cases import CASES, case_subject
from lensfit.errors import DetectionError


def refuses(folder):
    raise DetectionError("nothing to see", where=folder.name)


def breaks(folder):
    raise ZeroDivisionError("division by zero")


def test_a_lens_that_fails_does_not_stop_the_others(tmp_path):
    trials = [Trial("dark", "no light", refuses), Trial("bad", "a fault", breaks)]
    result = bench_wavefront(trials, judge, tmp_path)
    assert [row["lens"] for row in result["rows"]] == ["dark", "bad"]
    assert "nothing to see" in result["errors"][0]
    fault = result["errors"][1]
    assert fault.startswith("bad: ZeroDivisionError: division by zero (test_bench_")
    assert json.loads((tmp_path / "bench_wavefront.json").read_text()) == result
    assert wavefront_table(result["rows"]).row_count == 2


def test_nothing_is_kept_without_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert bench_wavefront([Trial("bad", "", breaks)], judge)["errors"]
    assert list(tmp_path.iterdir()) == []


SHOOT = """
[lens]
name = "a lens"
[[target]]
name = "dots"
kind = "dot-grid"
pitch_mm = 10.0
[[take]]
image = "one.exr"
target = "dots"
"""


def test_a_take_that_is_not_there_is_told_before_any_fit(tmp_path):
    def write(folder):
        folder.mkdir(parents=True)
        (folder / "shoot.toml").write_text(SHOOT)

    beside = Beside(judge_spots, leave_out=("two",))
    trial = Trial("lens", "", write)
    result = bench_wavefront([trial], judge, tmp_path, beside=beside)
    assert "no take is called two" in result["errors"][0]
    assert "leave out one, or each" in result["errors"][0]
    assert set(result["rows"][0]["seconds"]) == {"photograph"}


def test_trials_are_random_lenses_and_then_cases():
    trials = trials_of(2, ["fast", "jpeg"], "320x240", seed=4)
    assert [t.name for t in trials][2:] == ["fast", "jpeg"]
    assert len({t.name for t in trials}) == 4
    everything = trials_of(0, ["all", "nikkor_28"], "320x240", seed=4)
    assert len(everything) == len(CASES) + 1
    assert everything[-1].name == "nikkor_28"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--cases", "nosuch"], "--cases (all, overlapping,"),
        (["--size", "12"], "WIDTHxHEIGHT"),
        (["--lenses", "-1"], "greater than or equal to 0"),
    ],
)
def test_wrong_use_is_told_and_exits_with_two(words, says, tmp_path):
    out = tmp_path / "never"
    told = told_of_wrong_usage("bench", "wavefront", *words, "--out", str(out))
    assert says in told
    assert not out.exists()


@pytest.mark.slow
def test_a_traced_lens_is_calibrated_and_judged(tmp_path):
    subject = case_subject("left_out", (400, 300))
    trial = Trial("small", subject.about, subject.write)
    result = bench_wavefront([trial], judged, tmp_path)
    (row,) = result["rows"]
    assert row["failed"] is None
    assert max(row["figures"]["chief_ray_px"].values()) < 0.5
    assert row["figures"]["flags"] == [] or row["figures"]["psf"] is None
    assert np.isfinite(row["seconds"]["calibrate"])


@pytest.mark.hard
def test_a_stated_mosaic_is_not_taken_for_the_lens(tmp_path):
    subject = case_subject("bayer", (640, 480))
    result = bench_wavefront(
        [Trial("bayer", subject.about, subject.write)], judged, tmp_path
    )
    (row,) = result["rows"]
    assert row["failed"] is None
    assert 'mosaic = "rggb"' in (tmp_path / "bayer" / "shoot.toml").read_text()
    assert not any("mosaic" in note for note in row["report"]["notes"])
    psf = row["figures"]["psf"]["all"]
    assert psf["median"] < 0.04
    assert psf["p90"] < 0.12
    assert max(row["figures"]["chief_ray_px"].values()) < 0.03
    # Blue is .080 px off since all focus states share their colour; it was under .06.
    assert max(row["figures"]["lateral_colour_px"].values()) < 0.1
