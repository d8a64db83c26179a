"""One run of all benchmarks: rows with bars, and what is left out is said."""

import numpy as np
import pytest
from typer.testing import CliRunner

from data_synth.bench import every as module
from data_synth.bench.detect import bench_detect
from data_synth.bench.every import bench_all
from data_synth.bench.result import described, machine
from data_synth.bench.warp import _methods, warp_task
from data_synth.bench.wavefront.rows import wavefront_rows
from lensfit.cli.main import app
from lensfit.errors import LensfitError

FIGURES = {
    "chief_ray_px": {"in": 0.01, "near": 0.06},
    "lateral_colour_px": {"r-g": 0.01, "b-g": 0.02},
    "illumination_worst": {"f2": 0.015},
    "psf": {
        "all": {"median": 0.05, "p90": 0.25},
        "unseen_stop": {"median": 0.12, "p90": 0.2},
    },
    "defocus_sign": "right",
    "flags": [],
    "thin_lens": {"psf": {"all": {"median": 0.5, "p90": 1.1}}},
}


def test_every_figure_is_held_to_its_bar():
    rows = {r.what: r for r in wavefront_rows({"lens": "a", "figures": FIGURES})}
    assert rows["chief rays, px rms"].value == 0.06
    passed = {what: row.passed for what, row in rows.items()}
    assert passed == {
        "chief rays, px rms": False,
        "lateral colour, px rms": True,
        "relative illumination, worst": True,
        "psf, median": True,
        "psf, p90": False,
        "psf at a stop never shot, median": True,
        "psf at a stop never shot, p90": True,
        "sign of defocus wrong or undecided": True,
        "folds and negative light": True,
    }
    assert rows["psf, median"].peers == {"thin lens": 0.5}


def test_a_lens_that_failed_passes_nothing():
    assert [r.passed for r in wavefront_rows({"lens": "a", "figures": None})] == [False]


@pytest.mark.slow
def test_methods_of_the_warp_agree_with_the_exact_picture():
    task = warp_task(160, 90, seed=1)
    inside = np.s_[16:-16, 16:-16]
    for name, run in _methods(task).items():
        away = run()[..., 0][inside] - task.exact[inside]
        assert np.sqrt(np.mean(away**2)) < 4e-3, name
    assert np.ptp(task.exact) > 0.1


def test_without_data_photographs_are_left_out_and_said(monkeypatch):
    monkeypatch.setattr(module, "bench_warp", lambda *_, **__: {"rows": [{"set": "a"}]})
    monkeypatch.setattr(
        module, "bench_wavefront", lambda *_, **__: {"bars": [], "errors": ["b: no"]}
    )
    found = bench_all([], lambda *_: {}, None)
    assert found["rows"] == [{"bench": "warp", "set": "a"}]
    assert set(found["seconds"]) == {"warp", "wavefront"}
    assert found["errors"] == ["b: no"]
    assert "--data" in found["notes"][0]


def test_a_part_that_fails_costs_no_other(monkeypatch):
    def refuse(*_, **__):
        raise LensfitError("no picture")

    monkeypatch.setattr(module, "bench_warp", refuse)
    monkeypatch.setattr(
        module, "bench_wavefront", lambda *_, **__: {"bars": [], "errors": []}
    )
    found = bench_all([], lambda *_: {}, None)
    assert found["errors"] == ["warp: no picture"]


def test_the_machine_is_named_in_a_line():
    on = machine()
    assert on["cores"] >= 1
    assert str(on["processor"]) in described(on)
    assert "\n" not in described(on)


def test_sets_without_photographs_are_errors_of_their_own(tmp_path):
    found = bench_detect(tmp_path, only="gopro8")
    assert found["rows"] == []
    assert "gopro8" in found["errors"][0]


@pytest.mark.parametrize("command", ["detect", "all"])
def test_a_folder_without_photographs_is_one_line(command, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "bench_warp", lambda *_, **__: {"rows": []})
    monkeypatch.setattr(
        module, "bench_wavefront", lambda *_, **__: {"bars": [], "errors": []}
    )
    words = ["bench", command, "--data", str(tmp_path)]
    found = CliRunner().invoke(
        app, [*words, *(["--quick"] if command == "all" else [])]
    )
    assert found.exit_code == 1
    assert "photographs are missing" in found.stderr
    assert "Traceback" not in found.stderr


def test_dots_of_a_real_photograph_are_counted_beside_blobs(data_dir):
    found = bench_detect(data_dir, only="dot_pattern_05")
    rows = {row["what"]: row for row in found["rows"]}
    assert rows["points found and numbered"]["passed"]
    assert rows["reading, finding, numbering, s"]["value"] > 0
