"""The main job, end to end, on the bundled shoot whose truth is known."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import cv2
import jax
import msgspec
import numpy as np
import pytest
from bundled_shoot import DEMO, demo_in_focus

from lensfit.coords import mm_from_px
from lensfit.errors import DetectionError, FitError
from lensfit.io.stmap import read_stmap
from lensfit.preset.store import load_preset
from lensfit.report.verdict import verdict
from lensfit.workflow import calibrate as job
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.calibration.entry_facts import is_of_lighting_too
from lensfit.workflow.shoot.shoot_file import load_shoot


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """The demo's three photographs in focus, and one that does not exist."""
    shoot = demo_in_focus()
    missing = msgspec.structs.replace(shoot.takes[0], image="missing.jpg")
    shoot = msgspec.structs.replace(shoot, takes=(*shoot.takes, missing))
    out = tmp_path_factory.mktemp("shoot") / "out"
    report = calibrate(shoot, out)
    return report, out


@pytest.mark.parametrize(("column", "within_px"), [("centroid", 0.02), ("chief", 0.1)])
def test_marks_agree_with_the_exact_ray_trace(calibrated, column, within_px):
    """Up to the pose of the chart, which an affine map absorbs.

    The fit is one of centroids, which coma carries away from the chief rays by .07 px
    rms; holes as large as these do not show it.
    """
    _, out = calibrated
    lens = load_preset(out / "preset.json").at()
    truth = json.loads((DEMO / "dots_truth.json").read_text())
    landed, objects = _truth_of(truth, column)
    ours = np.asarray(lens.project(objects))
    theirs = mm_from_px(landed, (1280, 960), (28.0, 21.0))
    design = np.c_[ours, np.ones(len(ours))]
    aligned = design @ np.linalg.lstsq(design, theirs, rcond=None)[0]
    error_px = np.linalg.norm(aligned - theirs, axis=1) / (28.0 / 1280)
    assert np.sqrt(np.mean(error_px**2)) < within_px


def test_the_entrance_pupil_is_where_the_ray_trace_has_it(calibrated):
    """Twice as far in front of the sensor as a thin lens would have it."""
    _, out = calibrated
    (entry,) = load_preset(out / "preset.json").entries
    truth = json.loads((DEMO / "dots_truth.json").read_text())
    found_mm = entry.projection.entrance_pupil_offset_mm
    assert found_mm == pytest.approx(truth["entrance_pupil_from_sensor_mm"], abs=1.5)
    # One tilted chart shows little of the shift of this pupil.
    assert set(entry.projection.assumed) <= {"pupil_shift"}


def _truth_of(truth, column):
    """Chief rays or centroids in green within the frame, px, and object points, mm."""
    dots = np.asarray(truth["dots"])
    chief = truth["columns"].index("chief_g_x_px")
    inside = (dots[:, chief : chief + 2] > 0) & (
        dots[:, chief : chief + 2] < (1280, 960)
    )
    dots = dots[np.all(inside, axis=1)]
    plane = dots[:, :2] * truth["chart"]["pitch_mm"]
    distance = np.full((len(dots), 1), truth["pose"]["distance_mm"])
    first = truth["columns"].index(f"{column}_g_x_px")
    return dots[:, first : first + 2], np.hstack([plane, distance])


def test_held_out_error_is_near_the_noise_of_the_photographs(calibrated):
    report, _ = calibrated
    assert report["held_out_rms_px"] < 0.03
    assert report["points_used"] >= 0.99 * report["points_detected"]


def test_a_missing_photograph_is_named_and_stops_nothing(calibrated):
    report, out = calibrated
    failed = [take for take in report["takes"] if take["failed"]]
    assert [take["image"] for take in failed] == ["missing.jpg"]
    assert "missing.jpg" in failed[0]["failed"]
    assert json.loads((out / "report.json").read_text())["takes"][3]["failed"]
    assert (out / "report.html").stat().st_size > 20_000


def test_the_maps_undo_each_other(calibrated):
    report, out = calibrated
    assert report["entries"][0]["round_trip_max_px"] < 1e-3
    assert report["entries"][0]["monotone"]
    names = report["files"]["stmaps"]
    assert len(names) == 2
    for name in names:
        uv = read_stmap(out / name).uv
        assert np.isfinite(uv).all()


def test_the_preset_says_what_was_tried_and_how_sure_it_is(calibrated):
    _, out = calibrated
    entry = load_preset(out / "preset.json").entries[0]
    radial = next(t for t in entry.terms if t.name.startswith("radial") and t.kept)
    assert "BIC" in radial.reason
    assert any(not t.kept for t in entry.terms)
    assert entry.covariance is not None
    assert entry.quality.photographs == 3


def test_the_preset_says_what_it_was_computed_with(calibrated):
    """By the modules in use: a package of OpenCV may have another name."""
    _, out = calibrated
    versions = load_preset(out / "preset.json").provenance.versions
    assert versions["opencv"] == cv2.__version__
    assert versions["jax"] == jax.__version__


def test_the_preset_says_how_good_it_is_over_the_whole_frame(calibrated):
    _, out = calibrated
    for entry in load_preset(out / "preset.json").entries:
        assert 0 < entry.quality.largest_standard_deviation_px < 5
        assert entry.quality.round_trip_px < 1e-6


def test_what_nobody_said_of_the_dots_is_why_blur_is_not_measured(calibrated):
    report, _ = calibrated
    (without,) = report["blur_not_measured"]
    assert without["focal_length_mm"] == 28.0
    assert any("state hole_diameter_mm of the dots" in one for one in verdict(report))
    assert f"28 mm was not measured: {without['reason']}" in report["notes"][-1]


def test_fall_off_is_of_the_lens_alone_where_marks_shine(calibrated):
    report, _ = calibrated
    curves = report["entries"][0]["fall_off"]
    assert [curve["lighting_too"] for curve in curves] == [False]
    dark, bright = (
        SimpleNamespace(f_number=4.0, observations=SimpleNamespace(bright=shines))
        for shines in (False, True)
    )
    assert is_of_lighting_too((bright, dark), 4.0)
    assert not is_of_lighting_too((bright, dark), 8.0)


def test_no_photograph_at_all_is_one_sentence(tmp_path):
    text = (DEMO / "shoot.toml").read_text()
    (tmp_path / "shoot.toml").write_text(text)
    with pytest.raises(DetectionError, match=r"dots\.exr"):
        calibrate(load_shoot(tmp_path / "shoot.toml"), tmp_path / "out")
    assert not (tmp_path / "out" / "preset.json").exists()
    assert not (tmp_path / "out").exists()


def contents(folder: Path) -> dict[str, bytes]:
    found = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


@pytest.fixture
def again(calibrated, tmp_path):
    """The same results, to be replaced."""
    _, out = calibrated
    return Path(shutil.copytree(out, tmp_path / "again"))


def test_a_second_run_leaves_nothing_of_the_first_but_a_users_own_file(again):
    """Focused elsewhere, and of a photograph with another name."""
    (again / "stmaps" / "mine.exr").write_bytes(b"mine")
    renamed = shutil.copy(DEMO / "dots.exr", again.with_name("renamed.exr"))
    shoot = demo_in_focus()
    takes = [
        msgspec.structs.replace(take, focus_distance_mm=1600.0) for take in shoot.takes
    ]
    takes[0] = msgspec.structs.replace(takes[0], image=str(renamed))
    calibrate(msgspec.structs.replace(shoot, takes=tuple(takes)), again)
    found = [name for name in contents(again) if "/" in name]
    stems, lens = ("dots_tilted", "lines", "renamed"), "retrofocus-wide-angle-28-mm-f"
    assert sorted(found) == [
        *(f"model/{s}_{n}.jpg" for s in stems for n in ("left", "model", "photograph")),
        *(f"overlays/{stem}.png" for stem in stems),
        "stmaps/mine.exr",
        *(f"stmaps/{lens}-2-8_28mm_1600mm_{n}.exr" for n in ("redistort", "undistort")),
    ]


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), FitError("no lens fits")])
def test_a_run_that_stops_leaves_the_results_of_the_one_before(
    again, monkeypatch, stop
):
    def stopped(*_, **__):
        raise stop

    (again / "overlays" / "dots.png").write_bytes(b"of the first run")
    before = contents(again)
    shoot = demo_in_focus()
    monkeypatch.setattr(job, "fit", stopped)
    with pytest.raises(type(stop)) as caught:
        calibrate(msgspec.structs.replace(shoot, takes=shoot.takes[:1]), again)
    after = contents(again)
    if isinstance(stop, FitError):
        assert after.pop("overlays_failed/dots.png")
        assert f"are drawn in {again / 'overlays_failed'}" in str(caught.value)
    assert after == before
