"""`lensfit bench exchange`: what each format loses, told by the lens and the file."""

import json
import sys

import msgspec
import pytest
from command_line import run
from plate_makers import make_preset

from lensfit.exchange.export import FORMATS
from lensfit.preset.store import save_preset


def test_a_blender_that_does_not_run_is_one_line_after_the_table(tmp_path, monkeypatch):
    monkeypatch.setattr("data_synth.bench.exchange.FORMATS", ())
    save_preset(make_preset(), tmp_path / "preset.json")
    words = ["bench", "exchange", str(tmp_path / "preset.json"), "--size", "96x64"]
    words += ["--blender", sys.executable + "-none"]
    done = run(*words)
    assert done.exit_code == 1
    assert "landed, rms px" in done.stdout
    assert done.stderr.count("\n") == 1
    assert "Blender did not run" in done.stderr


@pytest.mark.slow
def test_every_format_has_its_residuals_both_ways(tmp_path, monkeypatch):
    """A lens of one radial term: opencv's model and maps hold it; 3DEqualizer's of
    degree four leaves what its series leaves, the same in both directions."""
    (entry,) = make_preset().entries
    plain = msgspec.structs.replace(entry, lateral_colour=None, fall_off=())
    preset = msgspec.structs.replace(make_preset(), entries=(plain,))
    save_preset(preset, tmp_path / "preset.json")
    monkeypatch.setitem(sys.modules, "pxr", None)
    words = ["bench", "exchange", str(tmp_path / "preset.json"), "--json"]
    words += ["--size", "480x320", "--out", str(tmp_path), "--f-number", "2.8"]
    done = run(*words)
    assert done.exit_code == 0, done.output
    rows = {row["format"]: row for row in json.loads(done.stdout)["formats"]}
    assert set(rows) == {*FORMATS} - {"nuke-stmap"}
    assert "usd-core" in rows.pop("usd")["error"]
    rays = rows.pop("cycles-osl")
    assert rays["landed"][1] < 0.02
    assert rays["landed"][0] <= rays["rays"][1] < 0.05
    for name, row in rows.items():
        assert "error" not in row, name
        (landed_rms, landed_worst), (straight_rms, straight_worst) = (
            row["landed"],
            row["straight"],
        )
        assert landed_rms <= landed_worst
        # Both are one difference, seen through a map that stretches by a fifth at most.
        assert straight_worst == pytest.approx(landed_worst, rel=0.5, abs=1e-3)
        assert straight_rms == pytest.approx(landed_rms, rel=0.5, abs=1e-3)
        assert row["imported"][1] < 0.05, name
    assert rows["opencv"]["landed"][1] < 1e-2
    assert rows["stmap"]["landed"][1] < 2e-3
    assert rows["stmap"]["straight"][1] < 2e-3
    found = json.loads(done.stdout)
    assert found["cycles"] == []
    assert "bpy" in found["notes"][0]
    kept = json.loads((tmp_path / "bench_exchange.json").read_text())
    assert {row["format"] for row in kept["formats"]} == {*rows, "usd", "cycles-osl"}
