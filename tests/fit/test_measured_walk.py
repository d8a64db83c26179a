"""Tilted charts show how the entrance pupil walks with field angle."""

import numpy as np
import pytest
from pinhole_shoot import FRONTAL, LATTICE, PITCH_MM, TILTED, Camera, observations
from pinhole_shoot import take_of as stated

from lensfit.detect.observations import only
from lensfit.fit.lens_states import fit
from lensfit.fit.pupil_walk import MeasuredWalk, shared_walk
from lensfit.fit.take import Take
from lensfit.workflow.calibration.entries import entry_of

WALK_MM, CHART_MM = -24.0, 900.0
CAMERA = Camera(30.0, (0.0, 0.0), k=(-0.05, 0.0))


def photographed(rotations, focus_mm: float, walk_mm: float = WALK_MM) -> list[Take]:
    """A pinhole that stands farther back for steeper rays."""
    camera = Camera(
        CAMERA.focal_length_mm, CAMERA.centre_mm, k=CAMERA.k, rotations=rotations
    )
    takes = []
    for view in range(len(rotations)):
        points = camera.camera_axes(view, LATTICE * PITCH_MM)
        across = (points[:, :2] ** 2).sum(-1)
        pupil_mm = 0.0
        for _ in range(20):
            ahead = points[:, 2] - pupil_mm
            pupil_mm = walk_mm * across / (across + ahead**2)
        points[:, 2] -= pupil_mm
        image = camera.image_mm(points)
        seen = observations(image, 0.02, view)
        inside = (np.abs(image) < [12.0, 9.0]).all(-1)
        name = f"view {view} focused at {focus_mm:g}"
        takes.append(stated(only(seen, inside), name, focus_distance_mm=focus_mm))
    return takes


@pytest.fixture(scope="module")
def states():
    """One state with tilted views, one without."""
    takes = photographed(TILTED, 2000.0) + photographed(FRONTAL[:1], 900.0)
    return {one.focus_distance_mm: one for one in fit(takes).states}


def test_tilted_views_show_the_walk(states):
    walk = states[2000.0].walk
    assert walk.standard_deviation_mm < 4.0
    off = abs(walk.walk_mm - WALK_MM)
    assert off < max(3 * walk.standard_deviation_mm, 0.15 * abs(WALK_MM))


def test_states_without_tilt_share_it(states):
    assert states[900.0].walk == states[2000.0].walk
    free = states[900.0].geometry.adjustment
    assert not free.prior.free[free.layout.blocks["pupil_walk"]].any()


def test_the_preset_tells_it_with_the_distance_of_the_chart(states):
    walk = entry_of(states[900.0]).projection.pupil_walk
    assert walk is not None
    assert walk.walk_mm == states[900.0].walk.walk_mm
    assert walk.chart_distance_mm == pytest.approx(CHART_MM + 30.0, rel=0.01)


def test_frontal_views_say_nothing():
    (state,) = fit(photographed(FRONTAL[:1], 900.0)).states
    assert state.walk is None
    assert entry_of(state).projection.pupil_walk is None


def test_a_pupil_that_stands_still_needs_no_term():
    (state,) = fit(photographed(TILTED, 2000.0, 0.0)).states
    assert state.walk is None
    verdicts = {one.name: one.kept for one in state.geometry.verdicts}
    assert verdicts["pupil_walk"] is False


def test_states_are_weighed():
    one, other = MeasuredWalk(-10.0, 1.0), MeasuredWalk(-20.0, 3.0)
    shared = shared_walk([one, None, other])
    assert shared is not None
    assert shared.walk_mm == pytest.approx(-11.0)
    assert shared.standard_deviation_mm == pytest.approx(0.9**0.5)
    assert shared_walk([None]) is None
