"""The blur of an anamorphic preset: ovals, depths, focus that nobody photographed."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from preset_makers import make_blur, make_entry, make_preset

import lensfit
from lensfit.lens import Lens
from lensfit.preset.blocks import AberrationTerm, Blur, Distortion, Projection, Pupil
from lensfit.preset.schema import Preset

SQUEEZE, FOCUS_MM, SIZE, PITCH_MM = 1.8, 2000.0, 96, 0.004
AXIS, FIELD = (0.0, 0.0), (5.0, 3.0)
FLAT = {
    "projection": Projection(51.3, (0.0, 0.0), 51.3),
    "distortion": Distortion(
        "rectilinear", 15.6, 1.02, (-0.8, -0.6, 0.8, 0.6), squeeze=SQUEEZE
    ),
    "lateral_colour": None,
}


def blur_of(**changes) -> Blur:
    ideal = {
        "aberrations": (),
        "pupil": Pupil(),
        "pupil_magnification": 1.0,
        "focus_offset_mm": 0.0,
        "chief_bend": 0.0,
        "stops": (),
        "reference_sine": 0.12,
        "beyond_offset_mm": 0.0,
    }
    return make_blur(**(ideal | changes))


def preset_of(**changes) -> Preset:
    return make_preset(make_entry(**FLAT, blur=blur_of(**changes)))


def lens_of(focus_mm: float = FOCUS_MM, **changes) -> Lens:
    return preset_of(**changes).at(50.0, 4.0, focus_mm)


def psf(lens: Lens, point=AXIS, distance_mm=1400.0, pitch_mm=PITCH_MM) -> np.ndarray:
    patch = lens.psf(point, distance_mm, pixel_pitch_mm=pitch_mm, size_px=SIZE)
    return np.asarray(patch)


def width_and_height_px(patch: np.ndarray) -> np.ndarray:
    """Standard deviations along x and y, without what the pixels themselves add."""
    x = np.arange(len(patch)) + 0.5
    shares = patch.sum(0), patch.sum(1)
    return np.sqrt([max(s @ x**2 - (s @ x) ** 2 - 1 / 12, 0.0) for s in shares])


@pytest.mark.parametrize("distance_mm", [1300.0, 3500.0, np.inf])
@pytest.mark.parametrize("focus_mm", [FOCUS_MM, 1700.0])
def test_bokeh_is_an_oval_of_the_squeeze_once_desqueezed(focus_mm, distance_mm):
    """At any depth, focused where it was photographed or elsewhere."""
    patch = psf(lens_of(focus_mm), AXIS, distance_mm, 2 * PITCH_MM)
    width, height = width_and_height_px(patch)
    assert height > 4
    np.testing.assert_allclose(height / (width * SQUEEZE), SQUEEZE, rtol=0.04)


@pytest.mark.parametrize("focus_mm", [FOCUS_MM, 1700.0])
def test_in_focus_both_sections_are_sharp(focus_mm):
    patch = psf(lens_of(focus_mm), AXIS, focus_mm)
    assert width_and_height_px(patch).max() < 1.2


def test_what_x_has_beyond_y_is_its_alone():
    (width, height), (wider, as_high) = (
        width_and_height_px(psf(lens_of(beyond_offset_mm=offset), AXIS, FOCUS_MM))
        for offset in (0.0, 0.3)
    )
    np.testing.assert_allclose(as_high, height, rtol=0.02)
    # A disc of this radius has half of it as its standard deviation.
    np.testing.assert_allclose(wider, 0.3 * 0.12 / 2 / PITCH_MM, rtol=0.05)
    assert width < 1


TWO_MIRRORS = (
    AberrationTerm(2, 2, 2, 0, "re", 9.0),
    AberrationTerm(3, 1, 1, -1, "re", 7.0),
    AberrationTerm(3, 3, 1, 1, "re", -5.0),
)


@pytest.mark.parametrize("mirror", [(-1, 1), (1, -1)])
def test_both_mirrors_hold(mirror):
    lens = lens_of(aberrations=TWO_MIRRORS)
    here = psf(lens, FIELD)
    there = psf(lens, tuple(np.multiply(FIELD, mirror)))
    error = np.linalg.norm(there[:: mirror[1], :: mirror[0]] - here)
    # Rays lie in a spiral, which has no mirror of its own.
    assert error < 0.03 * np.linalg.norm(here)
    assert np.linalg.norm(there - here) > 0.1 * np.linalg.norm(here)


def test_a_preset_file_keeps_all_of_it(tmp_path: Path):
    preset = preset_of(aberrations=TWO_MIRRORS, beyond_offset_mm=0.07)
    lensfit.save_preset(preset, tmp_path / "oval.json")
    read = lensfit.load_preset(tmp_path / "oval.json")
    wanted, found = (psf(p.at(50.0, 4.0, FOCUS_MM), FIELD) for p in (preset, read))
    np.testing.assert_array_equal(found, wanted)


def test_a_file_from_before_has_one_section(tmp_path: Path):
    path = tmp_path / "old.json"
    lensfit.save_preset(preset_of(), path)
    table = json.loads(path.read_text())
    del table["entries"][0]["blur"]["beyond_offset_mm"]
    path.write_text(json.dumps(table))
    lens = lensfit.load_preset(path).at(50.0, 4.0, FOCUS_MM)
    assert lens.blur is not None
    assert lens.blur.beyond_mm is None
    blur = preset_of().entries[0].blur
    assert blur is not None
    assert msgspec.structs.replace(blur, beyond_offset_mm=None) != blur
