"""What results say in the OpenEXR standard attributes, as any program reads it."""

import json
import math
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from command_line import run_well
from deep_files import write_deep
from plate_makers import CAMERA, DATA, SENSOR, make_preset, write_plate

ALL = {**CAMERA, **SENSOR}


def header(path: Path) -> dict:
    return OpenEXR.File(str(path), header_only=True).header()


def check(found: dict, f_number: float | None, focus_m: float) -> None:
    lens = make_preset().at(35.0, 2.8, 1000 * focus_m)
    principal_mm = float(lens.distortion.principal_distance_mm)
    assert found["nominalFocalLength"] == pytest.approx(35.0)  # mm
    assert found["pinholeFocalLength"] == pytest.approx(principal_mm, rel=1e-6)
    assert found["focus"] == pytest.approx(focus_m)  # metres
    assert found["entrancePupilOffset"] == pytest.approx(50.0)  # mm
    assert found["lens/aperture"] == pytest.approx(36.0)  # mm
    assert "sensorOverallDimensions" not in found  # nobody knows the whole sensor
    if f_number is not None:
        assert found["aperture"] == pytest.approx(f_number)


def test_a_frame_states_the_lens_that_it_carries(preset, tmp_path):
    plate = write_plate(tmp_path / "p.exr")
    run_well("apply", preset, plate, "--out", tmp_path / "out", "--no-defocus")
    found = header(tmp_path / "out" / "p.exr")
    check(found, 2.8, 2.0)
    assert found["lensModel"] == "Test 35"
    assert "lensSerialNumber" not in found  # nobody knows it
    assert "distortion" in found["lensfit/applied"]
    # What the plate's renderer said of this camera stays.
    assert found["lens/fstop"] == pytest.approx(2.8)


def test_it_is_what_was_applied_and_not_what_the_plate_said(preset, tmp_path):
    says = {"aperture": 24.0, "focus": 9.0, "lensModel": "other", **SENSOR}
    plate = write_plate(tmp_path / "p.exr", {"lens/focal": 35.0, **says})
    stated = ("--f-number", 4, "--focus-distance-mm", 1500)
    run_well("apply", preset, plate, "--out", tmp_path / "out", "--no-defocus", *stated)
    found = header(tmp_path / "out" / "p.exr")
    assert found["aperture"] == 4
    assert found["focus"] == pytest.approx(1.5)
    assert found["lensModel"] == "Test 35"


def test_what_the_preset_decided_is_stated_too(preset, tmp_path):
    plate = write_plate(tmp_path / "p.exr", SENSOR)
    run_well("apply", preset, plate, "--out", tmp_path / "out", "--no-defocus")
    check(header(tmp_path / "out" / "p.exr"), 2.8, 2.0)


def test_focus_at_infinity_is_infinite(preset, tmp_path):
    plate = write_plate(tmp_path / "p.exr")
    stated = ("--focus-distance-mm", "inf")
    run_well("apply", preset, plate, "--out", tmp_path / "out", "--no-defocus", *stated)
    assert math.isinf(header(tmp_path / "out" / "p.exr")["focus"])


@pytest.mark.parametrize("kind", ["deep", "aberration-dots", "circle-of-confusion"])
def test_every_kind_of_result_does(preset, tmp_path, kind):
    options = ["--depth-unit", "m", "--depth-kind", "perpendicular"]
    depth = np.full((DATA.height, DATA.width), 2.0, np.float32)
    plate = write_plate(tmp_path / "p.exr", extra={"Z": depth})
    if kind == "deep":
        counts = np.ones((64, 96), int)
        samples = {n: np.ones(counts.size, np.float32) for n in "RGBA"}
        samples["Z"] = np.full(counts.size, 2.0, np.float32)
        write_deep(plate, counts, samples, ALL)
    else:
        options += ["--output", kind]
    run_well("apply", preset, plate, "--out", tmp_path / "out", *options)
    check(header(tmp_path / "out" / "p.exr"), 2.8, 2.0)


def test_maps_do(preset, tmp_path):
    run_well("stmap", preset, "--size", "96x64", "--out", tmp_path / "maps")
    for path in (tmp_path / "maps").glob("*.exr"):
        check(header(path), None, 2.0)


def test_lensfit_reads_back_what_it_stated(preset, tmp_path):
    plate = write_plate(tmp_path / "p.exr", SENSOR)
    stated = ("--f-number", 2.8, "--focus-distance-mm", 2000)
    run_well("apply", preset, plate, "--out", tmp_path / "out", "--no-defocus", *stated)
    (said,) = json.loads(
        run_well("inspect", tmp_path / "out" / "p.exr", "--json").stdout
    )
    state = said["state"]
    assert (state["f_number"], state["focus_distance_mm"]) == (2.8, 2000)
    assert state["sensor_width_mm"] == pytest.approx(36)
    assert state["lens_model"] == "Test 35"
    assert not said["problems"]
