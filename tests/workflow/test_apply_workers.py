"""Frames on several processes, and jobs that are killed: the same files in the end."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from plate_makers import make_preset, sharp, write_plate

from lensfit.preset.store import save_preset
from lensfit.workflow.apply import apply

SCRIPT = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from lensfit.cli.main import main
main()
"""
"""Heeds an interrupt even where the tests run in the background of a shell, which has
its jobs ignore it."""


@pytest.fixture
def sequence(tmp_path):
    """Six frames, of which one is no picture and one would replace its own source."""
    for number in range(1, 7):
        write_plate(tmp_path / f"plate.{number:04d}.exr")
    (tmp_path / "plate.0003.exr").write_bytes(b"no picture")
    return tmp_path / "plate.####.exr"


def contents(folder):
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir())}


def test_workers_write_what_one_process_writes(sequence, tmp_path):
    told = []
    alone = apply(
        make_preset(), sequence, tmp_path / "alone", frames="1-7", options=sharp()
    )
    shared = apply(
        make_preset(),
        sequence,
        tmp_path / "shared",
        frames="1-7",
        workers=2,
        options=sharp(),
        progress=lambda *state: told.append(state),
    )
    assert contents(tmp_path / "alone") == contents(tmp_path / "shared")
    assert [p.name for p in shared.written] == [p.name for p in alone.written]
    assert [f.split(":")[0] for f in shared.failures] == [
        str(tmp_path / "plate.0003.exr"),
        str(tmp_path / "plate.0007.exr"),
    ]
    assert shared.notes == alone.notes
    assert told[0] == ("frames", 0, 7)
    assert told[-1] == ("frames", 7, 7)
    again = apply(
        make_preset(), sequence, tmp_path / "shared", workers=2, options=sharp()
    )
    assert len(again.skipped) == 5
    assert not again.written


def test_no_worker_renders_nothing(sequence, tmp_path):
    with pytest.raises(ValueError, match="0 workers"):
        apply(make_preset(), sequence, tmp_path / "out", workers=0)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_killed_job_run_again_ends_with_the_same_files(tmp_path):
    for number in range(8):
        write_plate(tmp_path / f"plate.{number:04d}.exr")
    preset, out = tmp_path / "preset.json", tmp_path / "out"
    save_preset(make_preset(), preset)
    pattern = tmp_path / "plate.####.exr"
    command = [sys.executable, "-c", SCRIPT, "apply", preset, pattern]
    for wanted in (1, 4):
        job = subprocess.Popen(
            [*map(str, command), "--out", str(out), "--no-defocus"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        while job.poll() is None and len(list(out.glob("[!.]*.exr"))) < wanted:
            time.sleep(0.002)
        job.kill()
        job.wait()
    # As a process leaves it that is killed while it writes.
    ended = job.pid
    from lensfit.atomic import _machine

    (out / f".plate.0007.{_machine()}-{ended}.abc.exr").write_bytes(b"half")
    (out / f".plate.0006.{_machine()}-{os.getpid()}0.abc.exr").touch()
    applied = apply(make_preset(), pattern, out, options=sharp())
    assert applied.failures == []
    assert len(applied.written) + len(applied.skipped) == 8
    apply(make_preset(), pattern, tmp_path / "whole", options=sharp())
    assert contents(out) == contents(tmp_path / "whole")


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize(
    ("killed", "most_lost"), [(1, 1), pytest.param(2, 5, marks=pytest.mark.slow)]
)
def test_a_worker_that_dies_costs_the_frame_it_was_at(tmp_path, killed, most_lost):
    plates = [write_plate(tmp_path / f"plate.{n:04d}.exr") for n in range(6)]

    def kill(stage, done, total):
        if done == 1:
            for child in multiprocessing.active_children()[:killed]:
                child.kill()
                child.join()

    done = apply(
        make_preset(),
        tmp_path / "plate.####.exr",
        tmp_path / "out",
        workers=2,
        options=sharp(),
        progress=kill,
    )
    assert len(done.written) + len(done.failures) == len(plates)
    assert len(done.failures) <= most_lost
    assert all("a worker process died" in failure for failure in done.failures)
    if killed == 2:
        assert len(done.failures) >= len(plates) - 3
    assert not multiprocessing.active_children()


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize("how", ["SIGKILL", "SIGTERM", "SIGINT"])
def test_a_run_with_workers_that_is_killed_has_nothing_to_clean_up(tmp_path, how):
    for number in range(40):
        write_plate(tmp_path / f"plate.{number:04d}.exr")
    preset, out = tmp_path / "preset.json", tmp_path / "out"
    save_preset(make_preset(), preset)
    words = [
        "apply",
        preset,
        tmp_path / "plate.####.exr",
        "--out",
        out,
        "--no-defocus",
        "--progress",
        "none",
    ]
    with subprocess.Popen(
        [sys.executable, "-c", SCRIPT, *map(str, words), "--workers", "2"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as job:
        while job.poll() is None and not list(out.glob("[!.]*.exr")):
            time.sleep(0.01)
        job.send_signal(getattr(signal, how))
        assert job.wait(60) != 0
        assert job.stderr is not None
        said = job.stderr.read()
    assert said == ("" if how == "SIGKILL" else "lensfit: error: interrupted\n")
    if how != "SIGKILL":
        assert all(not path.name.startswith(".") for path in out.iterdir())


def test_options_travel_to_processes(sequence):
    import pickle

    from lensfit.plate.apply_options import ApplyOptions

    preset = make_preset(35.0, 70.0)
    again = pickle.loads(pickle.dumps((preset, ApplyOptions(edge_mask=("a",)))))
    assert again == (preset, ApplyOptions(edge_mask=("a",)))
    assert np.isclose(again[0].entries[1].focal_length_mm, 70)
