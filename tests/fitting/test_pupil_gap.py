"""Behind cylinders x and y have a centre of projection each."""

import numpy as np
import pytest
from pinhole_shoot import FRONTAL, LATTICE, PITCH_MM, TILTED, Camera, observations
from pinhole_shoot import take_of as stated

from lensfit.detect.observations import only
from lensfit.fitting.chart_view import View
from lensfit.fitting.chief_ray import fit_chief_ray

pytestmark = pytest.mark.slow

SQUEEZE, GAP_MM, FOCAL_MM = 1.8, 55.0, 30.0


def photographed(rotations, squeeze: float = SQUEEZE) -> list[View]:
    """A pinhole whose x is squeezed, and sees everything from farther ahead."""
    camera = Camera(FOCAL_MM, (0.0, 0.0), rotations=rotations)
    takes = []
    for view in range(len(rotations)):
        points = camera.camera_axes(view, LATTICE * PITCH_MM)
        points[:, 0] *= points[:, 2] / (points[:, 2] - GAP_MM)
        image = camera.image_mm(points) * [SQUEEZE**-0.5, SQUEEZE**0.5]
        seen = observations(image, 0.01, view)
        inside = (np.abs(image) < [12.0, 9.0]).all(-1)
        changes = {"squeeze": squeeze, "focal_length_mm": FOCAL_MM}
        takes.append(stated(only(seen, inside), f"view {view}", **changes))
    return takes


def gap_mm(fitted) -> float:
    adjustment = fitted.adjustment
    gap = adjustment.parameters[adjustment.layout.blocks["pupil_gap"]][0]
    return float(gap * adjustment.frame.stated_focal_length_mm)


@pytest.fixture(scope="module")
def tilted():
    return fit_chief_ray(photographed(TILTED))


def test_views_from_several_sides_find_both_pupils(tilted):
    np.testing.assert_allclose(gap_mm(tilted), GAP_MM, rtol=0.02)
    assert tilted.held_out_rms_px < 0.02


def test_the_map_is_that_of_the_boards_distance(tilted):
    """There both centres say the same: x is drawn out by z / (z - gap)."""
    adjustment = tilted.adjustment
    blocks, frame = adjustment.layout.blocks, adjustment.frame
    squeeze = adjustment.parameters[blocks["squeeze"]] + frame.stated_squeeze
    wanted = np.log(SQUEEZE * (1 - GAP_MM / float(frame.board_distance_mm)))
    np.testing.assert_allclose(squeeze, [wanted, 0.0], atol=2e-3)


def test_frontal_views_are_silent_about_the_gap():
    fitted = fit_chief_ray(photographed(FRONTAL)[:1])
    assert gap_mm(fitted) == 0
    assert fitted.held_out_rms_px < 0.02


def test_a_lens_that_squeezes_nothing_has_one_pupil():
    layout = fit_chief_ray(photographed(TILTED[:1], 1.0)).adjustment.layout
    gap = layout.blocks["pupil_gap"]
    assert gap.start == gap.stop
