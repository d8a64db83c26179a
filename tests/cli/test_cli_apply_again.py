"""`lensfit apply` run again: what is skipped, rendered anew, kept and refused."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plate_makers import CAMERA, DATA, SENSOR, make_preset, scene, write_plate
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.plate.frame.provenance import FINGERPRINT
from lensfit.preset.store import save_preset

ALL = {**CAMERA, **SENSOR}


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """A preset and two plates."""
    save_preset(make_preset(), tmp_path / "preset.json")
    for number in (1, 2):
        write_plate(tmp_path / f"p.{number}.exr")
    return tmp_path


def apply(job: Path, *options: object, plates: str = "p.#.exr", defocus: bool = False):
    words = ["apply", job / "preset.json", job / plates, "--out", job / "out", "--json"]
    words += [] if defocus else ["--no-defocus"]
    done = CliRunner().invoke(app, [str(word) for word in (*words, *options)])
    return done, json.loads(done.stdout)


def names(paths: list[str]) -> list[str]:
    return [Path(path).name for path in paths]


def test_what_would_be_rendered_now_is_skipped(job):
    done, said = apply(job)
    assert (done.exit_code, names(said["written"])) == (0, ["p.1.exr", "p.2.exr"])
    before = (job / "out" / "p.1.exr").read_bytes()
    _, said = apply(job)
    assert names(said["skipped"]) == ["p.1.exr", "p.2.exr"]
    shutil.copytree(job, job / "moved")
    (job / "moved" / "p.1.exr").touch()  # neither the place nor the time counts
    _, said = apply(job / "moved")
    assert names(said["skipped"]) == ["p.1.exr", "p.2.exr"]
    assert (job / "out" / "p.1.exr").read_bytes() == before


@pytest.mark.parametrize("options", [(), ("--keep",)])
def test_a_frame_whose_pixels_were_lost_is_rendered_again(job, options):
    """Its header and its length are whole."""
    apply(job)
    target = job / "out" / "p.1.exr"
    whole = target.read_bytes()
    at = len(whole) * 3 // 4
    target.write_bytes(whole[:at] + bytes(300) + whole[at + 300 :])
    done, said = apply(job, *options)
    assert done.exit_code == 0
    assert names(said["written"]) == ["p.1.exr"]
    assert names(said["skipped"]) == ["p.2.exr"]
    assert f"{target} was damaged and is rendered again" in said["notes"]
    assert target.read_bytes() == whole


def new_plate(job):
    changed = {"R": scene(DATA)[..., 0] * np.float32(1.5)}
    write_plate(job / "p.2.exr", extra=changed)
    return [], ["p.2.exr"], "p.2.exr: finished before from another plate"


def new_preset(job):
    save_preset(make_preset(stops=(2.8, 4.0)), job / "preset.json")
    return [], ["p.1.exr", "p.2.exr"], "p.1.exr: finished before with another preset"


def new_settings(job):
    (job / "lensfit.toml").write_text('[[frames]]\nrange = "2"\nf_number = 2.801\n')
    return [], ["p.2.exr"], "p.2.exr: finished before with other settings"


def other_option(*options):
    def change(job):
        told = "p.1.exr: finished before with other settings"
        return options, ["p.1.exr", "p.2.exr"], told

    return change


CHANGES = {
    "plate": new_plate,
    "preset": new_preset,
    "settings": new_settings,
    "sensor": other_option("--sensor-width-mm", 35.9),
    "tolerance": other_option("--tolerance", 0.01),
    "filter": other_option("--filter", "keys-6"),
    "layer": other_option("--layer", ""),
    "window": other_option("--keep-overscan"),
    "switch": other_option("--no-falloff"),
    "knob": other_option("--distortion-gain", 1.1),
    "look": other_option("--bloom-gain", 0.1),
    "output": other_option("--output", "aberration-dots"),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", CHANGES)
def test_what_was_made_otherwise_is_rendered_again(job, what):
    apply(job)
    before = {p.name: p.read_bytes() for p in (job / "out").iterdir()}
    options, stale, told = CHANGES[what](job)
    kept, said = apply(job, *options, "--keep")
    assert kept.exit_code == 1
    assert len(said["failures"]) == len(stale)
    for name, failure in zip(stale, said["failures"], strict=True):
        assert failure.startswith(f"{job / name}: ")
        assert "was finished before" in failure
        assert "--keep" in failure
    assert {p.name: p.read_bytes() for p in (job / "out").iterdir()} == before
    done, said = apply(job, *options)
    assert done.exit_code == 0
    assert names(said["written"]) == stale
    assert [note for note in said["notes"] if note.startswith(told)]
    for name in stale:
        assert (job / "out" / name).read_bytes() != before[name]
    _, said = apply(job, *options)
    assert names(said["skipped"]) == ["p.1.exr", "p.2.exr"]


def test_a_map_counts_by_what_it_holds(job):
    words = ["stmap", job / "preset.json", "--size", "96x64", "--overscan", 30]
    CliRunner().invoke(app, [str(w) for w in (*words, "--out", job / "maps")])
    (found,) = (job / "maps").glob("*redistort*.exr")
    shutil.copy(found, job / "map.exr")
    apply(job, "--stmap", job / "map.exr")
    shutil.copy(found, job / "same.exr")
    _, said = apply(job, "--stmap", job / "same.exr")
    assert len(said["skipped"]) == 2
    part = read_exr(found).parts[0]
    moved = {n: s + np.float32(0.01) for n, s in part.channels.items()}
    other = ExrPart(moved, part.data_window, part.display_window, part.attributes)
    write_exr(job / "map.exr", ExrImage((other,)))
    _, said = apply(job, "--stmap", job / "map.exr")
    assert len(said["written"]) == 2


def test_a_frame_without_a_fingerprint_is_rendered_again(job):
    apply(job)
    target = job / "out" / "p.1.exr"
    part = read_exr(target).parts[0]
    assert part.attributes[FINGERPRINT].count("=") == 4
    plain = {k: v for k, v in part.attributes.items() if k != FINGERPRINT}
    old = ExrPart(part.channels, part.data_window, part.display_window, plain)
    write_exr(target, ExrImage((old,)))
    _, said = apply(job)
    assert names(said["written"]) == ["p.1.exr"]
    assert "left no fingerprint" in " ".join(said["notes"])


def test_a_picture_that_lensfit_did_not_render_is_not_replaced(job):
    (job / "out").mkdir()
    shutil.copy(job / "p.2.exr", job / "out" / "p.1.exr")
    before = (job / "out" / "p.1.exr").read_bytes()
    done, said = apply(job)
    assert done.exit_code == 1
    (failure,) = said["failures"]
    assert "no frame that lensfit rendered" in failure
    assert (job / "out" / "p.1.exr").read_bytes() == before
    _, said = apply(job, "--overwrite")
    assert len(said["written"]) == 2


def test_a_plate_that_carries_a_lens_is_refused(job):
    apply(job)
    for number in (1, 2):
        shutil.copy(job / "out" / f"p.{number}.exr", job / f"q.{number}.exr")
    for finished in (False, True):
        done, said = apply(job, plates="q.#.exr")
        assert done.exit_code == 1
        assert len(said["failures"]) == 2
        assert "carries a lens already (lensfit 0" in said["failures"][0]
        assert "--again" in said["failures"][0]
        if not finished:
            insisted, _ = apply(job, "--again", plates="q.#.exr")
            assert insisted.exit_code == 0
    header = read_exr(job / "out" / "q.1.exr", header_only=True).parts[0].attributes
    assert "Test 35" in str(header["lensfit/applied_before"])
    planned = CliRunner().invoke(
        app, ["plan", str(job / "preset.json"), str(job / "q.1.exr"), "--no-defocus"]
    )
    assert planned.exit_code == 1
    assert "carries a lens already" in planned.stderr


def test_no_depth_is_an_error_unless_depth_of_field_is_left_out(job):
    done, said = apply(job, defocus=True)
    assert done.exit_code == 1
    for failure in said["failures"]:
        assert "no depth channel" in failure
        assert "--no-defocus" in failure
    assert not (job / "out").exists()
    assert apply(job)[0].exit_code == 0


@pytest.mark.parametrize(
    ("f_number", "told"),
    [(2.8, None), (22.0, None), (24.0, "film back"), (0.2, "like")],
)
def test_an_aperture_that_is_no_f_number_is_named(job, f_number, told):
    header = {"lens/focal": 35.0, "focus": 2.0, "aperture": f_number, **SENSOR}
    write_plate(job / "a.1.exr", header)
    _, said = apply(job, plates="a.1.exr")
    found = [note for note in said["notes"] if "(aperture)" in note]
    assert len(found) == (told is not None)
    assert all(told in note and "--f-number" in note for note in found)
    _, said = apply(job, "--f-number", f_number, plates="a.1.exr")
    assert not [note for note in said["notes"] if "looks like" in note]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("depth", "unit", "told"),
    [
        (2.0, "m", None),
        (2000.0, "m", "mm"),
        (200.0, "m", "cm"),
        (2.0, "mm", "m"),
        (1000.0, "m", None),  # far away, and some of it in focus
    ],
)
def test_depths_that_put_everything_out_of_focus_are_named(job, depth, unit, told):
    plane = np.full((DATA.height, DATA.width), depth, np.float32)
    plane[:, :40] *= 1.1
    if depth == 1000.0:
        plane[:, 60:] = 2.1
    write_plate(job / "z.1.exr", {**ALL, "lens/fstop": 1.0}, {"Z": plane})
    options = ("--depth-unit", unit, "--depth-kind", "perpendicular")
    done, said = apply(job, *options, plates="z.1.exr", defocus=True)
    assert done.exit_code == 0, said
    found = [note for note in said["notes"] if "nothing is in focus" in note]
    assert len(found) == (told is not None)
    for note in found:
        assert (
            told
            in note.split("; in ")[1].split(" it would be (--depth-unit")[0].split()
        )


def test_keep_and_overwrite_exclude_each_other(job):
    words = ["apply", "p.json", "p.exr", "--out", "out", "--keep", "--overwrite"]
    assert CliRunner().invoke(app, words).exit_code == 2


@pytest.mark.parametrize(
    ("kind", "lines", "shares"),
    [("auto", 3, 0), ("lines", 3, 0), ("openjd", 3, 3), ("none", 0, 0)],
)
def test_a_line_for_each_frame_where_there_is_no_terminal(job, kind, lines, shares):
    apply(job)
    write_plate(job / "p.3.exr", {})  # states no camera and fails
    done, _ = apply(job, "--progress", kind, "--no-falloff")
    told = done.stderr.splitlines()
    frames = [line for line in told if line.startswith("lensfit: frame ")]
    assert len(frames) == lines
    if lines:
        assert frames[0] == "lensfit: frame 1 of 3: p.1.exr written"
    found = [line for line in told if line.startswith("openjd_progress: ")]
    wanted = [
        "openjd_progress: 33.3",
        "openjd_progress: 66.7",
        "openjd_progress: 100.0",
    ]
    assert found == wanted[:shares]


def test_a_farm_worker_is_told_how_far_a_task_is(job):
    """By the implementation of Open Job Description itself."""
    words = ["submit", job / "preset.json", job / "p.#.exr", "--out", job / "out"]
    words += ["--no-defocus", "--json"]
    said = json.loads(CliRunner().invoke(app, [str(w) for w in words]).stdout)
    bin_folder = str(Path(sys.executable).parent)
    run = subprocess.run(
        [sys.executable, "-m", "openjd", *said["run"][1:], "--verbose"],
        capture_output=True,
        text=True,
        timeout=180,
        env={**os.environ, "PATH": os.pathsep.join([bin_folder, os.environ["PATH"]])},
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "openjd_progress: 50.0" in run.stdout + run.stderr
    assert len(list((job / "out").glob("*.exr"))) == 2
