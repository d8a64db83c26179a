"""The door to the detectors: kinds, regions, refusals and notes."""

import numpy as np
import pytest
from drawn_grids import View, checkerboard, draw, line_grid, photograph

from lensfit.detect.find import observe
from lensfit.errors import DetectionError

LINES = draw(View(), line_grid(0.1), blur_px=0.7)
BOARD = draw(View(), checkerboard(7, 5), blur_px=0.7)


def test_a_region_changes_neither_positions_nor_steps_of_what_lies_inside():
    whole = observe(photograph(BOARD), "checkerboard")
    roi = (60.5, 40.0, 215.0, 210.0)
    part = observe(photograph(BOARD), "checkerboard", roi=roi)
    inside = ((whole.points_px > roi[:2]) & (whole.points_px < roi[2:])).all(1)
    assert 9 <= len(part) <= inside.sum() < len(whole)
    distance = np.linalg.norm(part.points_px[:, None] - whole.points_px, axis=2)
    assert distance.min(1).max() < 1e-2
    shift = part.lattice - whole.lattice[distance.argmin(1)]
    assert (shift == shift[0]).all()
    assert part.image_size_px == (300, 240)


def test_no_line_sample_lies_outside_the_region():
    roi = (40.0, 30.0, 250.0, 200.0)
    found = observe(photograph(LINES), "line-grid", roi=roi)
    assert ((found.points_px >= roi[:2]) & (found.points_px <= roi[2:])).all()
    assert set(found.family) == {0, 1}


@pytest.mark.parametrize("kind", ["dot-grid", "line-grid", "checkerboard"])
def test_a_picture_without_that_target_is_refused_with_advice(kind):
    ramp = np.linspace(0.1, 0.7, 300) * np.ones((240, 1))
    texture = ramp + np.random.default_rng(1).normal(0, 0.02, ramp.shape)
    with pytest.raises(DetectionError) as refusal:
        observe(photograph(texture), kind)
    sentence = str(refusal.value)
    assert sentence.startswith("drawn.exr: ")
    assert refusal.value.remedy
    assert "\n" not in sentence


def test_unknown_kinds_and_empty_regions_say_what_would_do():
    with pytest.raises(DetectionError, match="use one of dot-grid, line-grid"):
        observe(photograph(LINES), "hexagons")
    for roi in ((10, 10, 10, 200), (900, 900, 1000, 1000), (200, 10, 50, 200)):
        with pytest.raises(DetectionError, match="300 x 240"):
            observe(photograph(LINES), "line-grid", roi=roi)


def test_blank_clipped_and_broken_pictures_are_told_apart():
    with pytest.raises(DetectionError, match="blank"):
        observe(photograph(np.zeros((100, 100))), "line-grid")
    white = photograph(np.ones((100, 100)), saturation=1.0)
    with pytest.raises(DetectionError, match="over-exposed throughout"):
        observe(white, "checkerboard")
    nearly = np.ones((200, 200))
    nearly[90:110] = 0.2
    with pytest.raises(DetectionError, match="90% of the picture is over-exposed"):
        observe(photograph(nearly, saturation=1.0), "checkerboard")
    broken = LINES.copy()
    broken[3, 4] = np.nan
    with pytest.raises(DetectionError, match="1 samples are no finite"):
        observe(photograph(broken), "line-grid")


def test_notes_tell_of_clipping_little_coverage_and_a_wrong_count():
    small = View(size_px=(600, 480), pitch_px=24.0, radial=0.0)
    image = draw(small, checkerboard(7, 5), blur_px=0.8)
    found = observe(
        photograph(image, saturation=0.79), "checkerboard", board={"squares": (7, 6)}
    )
    notes = " ".join(found.notes)
    assert "35 of 35 marks touch clipped samples" in notes
    assert "of the width" in notes
    assert "8 x 6 squares are seen, but the target has 7 x 6." in notes
    assert not observe(photograph(LINES), "line-grid").notes
