"""`lensfit preset`: what it prints, and how it names faults."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from lensfit.preset.store import load_preset

PRESET = Path(__file__).parent / "tiny_preset.json"


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    path = tmp_path / "broken.json"
    path.write_text(PRESET.read_text().replace('"kept": true', '"kept": "yes"'))
    return path


def test_show_says_which_lens_and_each_entry():
    result = run("preset", "show", PRESET, env={"COLUMNS": "200"})
    assert result.exit_code == 0
    assert "SMC Takumar 50/1.4, serial 1234567" in result.stdout
    assert "50 mm focused at infinity" in result.stdout
    assert "51.3000 mm" in result.stdout


def test_show_says_whether_blur_was_measured(tmp_path: Path):
    tables = json.loads(PRESET.read_text())
    before = run("preset", "show", PRESET, env={"COLUMNS": "200"})
    tables["entries"][0]["blur"] = {
        "aberrations": [
            {"degree": 2, "order": 0, "field_degree": 2, "field_order": 0}
            | {"part": "re", "um": 3.0}
        ],
        "field_radius_mm": 15.0,
        "reference_sine": 0.3,
        "exit_pupil_distance_mm": 60.0,
        "pupil_magnification": 1.0,
        "reference_distance_mm": "inf",
        "focus_offset_mm": 0.0,
        "pupil": {},
        "stops": [{"f_number": 1.4}, {"f_number": 5.6, "radius_ratio": 0.98}],
        "band_centres_nm": [610.0, 540.0, 460.0],
        "band_widths_nm": [26.0, 26.0, 26.0],
        "round_f_number": 1.4,
    }
    path = tmp_path / "blur.json"
    path.write_text(json.dumps(tables))
    after = run("preset", "show", path, env={"COLUMNS": "200"})
    assert after.exit_code == 0
    assert "1 terms f/1.4 f/5.6" in after.stdout
    assert "1 terms f/1.4" not in before.stdout


def test_show_as_json_is_the_preset():
    result = run("preset", "show", PRESET, "--json")
    assert json.loads(result.stdout) == json.loads(PRESET.read_text())


def test_validate_names_the_key_and_goes_on(broken: Path):
    result = run("preset", "validate", broken, PRESET)
    assert result.exit_code == 1
    assert result.stdout == f"{PRESET}: valid\n"
    assert result.stderr == (
        f"lensfit: error: {broken}: entries[0].terms[0].kept: "
        "expected true or false, got text\n"
    )


def test_validate_as_json_keeps_standard_output_clean(broken: Path):
    result = run("preset", "validate", broken, PRESET, "--json")
    assert result.exit_code == 1
    faults = json.loads(result.stdout)
    assert faults[str(PRESET)] is None
    assert "terms[0].kept" in faults[str(broken)]


def test_show_of_what_is_no_preset_is_one_line(tmp_path: Path):
    (tmp_path / "p.json").write_text("{}")
    result = run("preset", "show", tmp_path / "p.json")
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert "has no schema, so it is no lensfit preset" in result.stderr


CAMERA = {
    "focal_length_mm": 35.0,
    "f_number": 1.4,
    "focus_distance_m": 4.0,
    "sensor_width_mm": 28.25,
    "width_px": 960,
    "height_px": 540,
    "note": "of a CG renderer",
}


def test_a_thin_lens_blurs_as_the_cg_renderer_does(tmp_path: Path):
    camera, out = tmp_path / "camera.json", tmp_path / "thin.json"
    camera.write_text(json.dumps(CAMERA))
    made = run("preset", "thin-lens", camera, "--out", out)
    assert made.exit_code == 0, made.output
    pitch = 28.25 / 960
    for focus_mm, z_mm in ((4000.0, 1000.0), (4000.0, np.inf), (1500.0, 4000.0)):
        lens = load_preset(out).at(focus_distance_mm=focus_mm)
        assert lens.f_number == 1.4
        # (f / N) f |1/z - 1/s|, the disc of the renderer's pinhole picture
        radius_px = 25 * 35 * abs(1 / z_mm - 1 / focus_mm) / 2 / pitch
        reach = np.arange(41) - 20.0
        square = reach**2 + reach[:, None] ** 2
        for point in ((0.0, 0.0), (13.0, 7.0)):
            kernel = np.asarray(lens.psf(point, z_mm, pixel_pitch_mm=pitch, size_px=41))
            # a pixel by itself has a mean square of 1/6
            found = np.sqrt(2 * ((kernel * square).sum() - 1 / 6))
            assert found == pytest.approx(radius_px, rel=0.004)


def test_a_camera_that_is_no_thin_lens_is_refused(tmp_path: Path):
    camera, out = tmp_path / "camera.json", tmp_path / "thin.json"
    camera.write_text(json.dumps(CAMERA | {"aperture_blades": 6}))
    made = run("preset", "thin-lens", camera, "--out", out)
    assert made.exit_code == 1
    camera.write_text(json.dumps(CAMERA | {"f_number": 0}))
    made = run("preset", "thin-lens", camera, "--out", out)
    assert made.exit_code == 1
    assert not out.exists()
